"""Proof that a packing is sound: every grain closed, outward and convex, all inside the domain, none overlapping."""

from grainsdem.validation.checks import SHAPE, validate
from grainsdem.validation.comparison import compare

__all__ = ["SHAPE", "compare", "validate"]
