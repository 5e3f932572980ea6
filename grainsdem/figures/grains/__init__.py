"""What the grains of a bed are like: sieve curves, and where axes point."""

from grainsdem.figures.grains.gradings import grading_figure
from grainsdem.figures.grains.stereonets import stereonet

__all__ = ["grading_figure", "stereonet"]
