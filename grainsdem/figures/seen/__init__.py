"""What is seen of a bed: sections, the planform, and the statistics of both phases."""

from grainsdem.figures.seen.phases import phase_figure
from grainsdem.figures.seen.planforms import planform_figure
from grainsdem.figures.seen.sections import section_figure
from grainsdem.figures.seen.sheets import contact_sheet

__all__ = ["contact_sheet", "phase_figure", "planform_figure", "section_figure"]
