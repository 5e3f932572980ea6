"""Pure functions on flat arrays: the compiled kernels live here, each beside the thin wrapper that checks its input."""
