"""What pictures of grains may be asked to show: what colours the grains, and from where one looks.

It is here, and not with the figures, since the command line tells it without drawing anything.
"""

from __future__ import annotations

from typing import Literal

QUANTITIES = ("diameter", "sphericity", "height", "id", "class", "layers", "columns", "halves")
"""What `grainsdem.figures.render` colours grains by, besides an array."""

View = Literal["corner", "front", "side", "top"]
"""From where one looks: over a corner of the container, or straight on, without perspective."""
