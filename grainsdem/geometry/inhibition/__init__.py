"""Kernels of point processes in which points keep others away: who is near, in a grid of linked lists."""
