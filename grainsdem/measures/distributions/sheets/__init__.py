"""A laboratory's sieve sheets: what they hold, and how they are read."""

from grainsdem.measures.distributions.sheets.reading import Kind, parse_sieves, read_sieves
from grainsdem.measures.distributions.sheets.sheet import ASTM, SieveSheet, Unit, opening

__all__ = ["ASTM", "Kind", "SieveSheet", "Unit", "opening", "parse_sieves", "read_sieves"]
