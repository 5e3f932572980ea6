"""Grains that do not come from cells: named solids, random rocks, scans."""

from grainsdem.shapes.ellipsoids import ellipsoid, superellipsoid
from grainsdem.shapes.pouring import pack, scatter
from grainsdem.shapes.rocks import rock
from grainsdem.shapes.rounding import rounded
from grainsdem.shapes.scans import Scans, read
from grainsdem.shapes.sizing import sized, together
from grainsdem.shapes.solids import PLATONIC, box, platonic, prism

__all__ = [
    "PLATONIC",
    "Scans",
    "box",
    "ellipsoid",
    "pack",
    "platonic",
    "prism",
    "read",
    "rock",
    "rounded",
    "scatter",
    "sized",
    "superellipsoid",
    "together",
]
