"""Bodies that are pushed into a bed, and parts of the user's own: what they are, and what a bed exerts on them."""
