"""What makes a photograph of what is seen: the light, the grains' colours and texture, water on them, the lens."""
