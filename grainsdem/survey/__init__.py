"""Beds grown for every combination of some parameters, and what they measure as one table."""

from grainsdem.survey.plan import Survey, parse_vary, read
from grainsdem.survey.running import load, run

__all__ = ["Survey", "load", "parse_vary", "read", "run"]
