"""Pictures: a render of the packing, the grain-size curve, coordination, and energy over time. All PNG, no window."""

from grainsdem.figures.plots import coordination_histogram, energy_plot, size_histogram
from grainsdem.figures.renders import render
from grainsdem.figures.scene import QUANTITIES

__all__ = ["QUANTITIES", "coordination_histogram", "energy_plot", "render", "size_histogram"]
