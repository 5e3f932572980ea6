"""Tables and graphs: the grains' measures, and who touches whom."""
