"""Curves of experiments: stresses over strain, dilation, surfaces and profiles."""

from grainsdem.figures.curves.panels import Panel, curve_figure, experiment_figure, experiment_panels

__all__ = ["Panel", "curve_figure", "experiment_figure", "experiment_panels"]
