"""Curves of experiments: stresses over strain, dilation, surfaces and profiles."""

from grainsdem.figures.curves.panels import curve_figure
from grainsdem.panels import Panel

__all__ = ["Panel", "curve_figure"]
