"""A rotating drum: its shell, how well it mixes, and the experiment."""
