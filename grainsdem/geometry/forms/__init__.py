"""The form of grains from exact integrals: equivalent diameters, sphericities, axes, and the boxes around them."""
