"""Many beds: grown for every combination of some parameters and measured as one table, or photographed as a set."""

from grainsdem.survey.averaging import means
from grainsdem.survey.imaging import images
from grainsdem.survey.plan import Survey, parse_vary, read
from grainsdem.survey.rows import load
from grainsdem.survey.running import run

__all__ = ["Survey", "images", "load", "means", "parse_vary", "read", "run"]
