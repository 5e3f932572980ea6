"""Proof that a packing is sound: every grain closed, outward and convex, all inside the domain, none overlapping."""

from grainsdem.validation.checks import validate

__all__ = ["validate"]
