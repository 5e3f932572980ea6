"""Formats of discrete-element programs: grains as rigid bodies with masses, skins, springs and walls."""
