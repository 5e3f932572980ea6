"""Parts of the user's own that are joined to a bed, and how they are driven."""
