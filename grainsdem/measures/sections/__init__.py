"""Sections: the polygons in which planes cut a bed, their sizes and number by depth, and what stereology expects."""

from grainsdem.geometry.raster.slicing import mean_widths
from grainsdem.measures.sections.planes import Section, section
from grainsdem.measures.sections.profiles import section_profile
from grainsdem.measures.sections.stereology import expected_section, widths
from grainsdem.measures.sections.tables import section_summary, section_table
from grainsdem.measures.sections.unfolding import SectionKernel, Unfolded, unfold

__all__ = [
    "Section",
    "SectionKernel",
    "Unfolded",
    "expected_section",
    "mean_widths",
    "section",
    "section_profile",
    "section_summary",
    "section_table",
    "unfold",
    "widths",
]
