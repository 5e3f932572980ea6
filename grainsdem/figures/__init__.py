"""Pictures: renders, sections and planforms of packings, curves of sizes, contacts and energy. All PNG, no window."""

from grainsdem.figures.grains.gradings import grading_figure
from grainsdem.figures.grains.stereonets import stereonet
from grainsdem.figures.motion import animate, replay
from grainsdem.figures.plots import coordination_histogram, energy_plot, size_histogram
from grainsdem.figures.renders import render
from grainsdem.figures.seen import contact_sheet, phase_figure, planform_figure, section_figure
from grainsdem.looks import QUANTITIES

__all__ = [
    "QUANTITIES",
    "animate",
    "contact_sheet",
    "coordination_histogram",
    "energy_plot",
    "grading_figure",
    "phase_figure",
    "planform_figure",
    "render",
    "replay",
    "section_figure",
    "size_histogram",
    "stereonet",
]
