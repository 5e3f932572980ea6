"""Kernels for pairs of convex bodies: closest points, depth of an overlap, what touches what, planes between."""
