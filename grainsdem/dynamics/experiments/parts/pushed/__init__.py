"""Bodies of simple shapes, or of a mesh, that are pressed, dropped or rolled into a bed."""
