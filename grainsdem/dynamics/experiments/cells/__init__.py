"""What holds the grains of an experiment: six walls, a ring, a box of two halves."""

from grainsdem.dynamics.experiments.cells.annulus import Annulus
from grainsdem.dynamics.experiments.cells.shear_box import ShearBox
from grainsdem.dynamics.experiments.cells.six_walls import SixWalls

__all__ = ["Annulus", "ShearBox", "SixWalls"]
