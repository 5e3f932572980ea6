"""Moving pictures: a recorded motion as an animation."""

from grainsdem.figures.motion.animations import animate

__all__ = ["animate"]
