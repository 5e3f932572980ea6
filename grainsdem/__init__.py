"""Realistic granular material from tessellations, proven free of overlap and handed to physics."""

__version__ = "0.1.0"
