"""Formats that carry surfaces: what meshers, printers and viewers read."""
