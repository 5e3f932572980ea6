"""Convex cells cut plane by plane, in kernels: what the tessellation grows and what grains are inset with."""
