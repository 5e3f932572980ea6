"""Moving pictures: a recorded motion as an animation."""

from grainsdem.figures.motion.animations import animate
from grainsdem.figures.motion.replaying import replay

__all__ = ["animate", "replay"]
