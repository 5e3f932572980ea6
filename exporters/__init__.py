"""Writers of packings: one module a format, one row in `FORMATS`."""
