"""Scanned grains: surfaces of files made convex shapes of few corners."""

from grainsdem.shapes.scans.reading import MOST_ADDED, SUFFIXES, Scans, read

__all__ = ["MOST_ADDED", "SUFFIXES", "Scans", "read"]
