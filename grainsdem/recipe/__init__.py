"""A bed described in a TOML file, read into a typed model, and the chain that makes it."""

from grainsdem.recipe.chain import Result, come_to_rest, keeping_last_good, run
from grainsdem.recipe.changing import varied, with_images
from grainsdem.recipe.growing import grow
from grainsdem.recipe.tables import EXAMPLE, Recipe, make, parse, read
from grainsdem.recipe.words import Monitor, Silent, counting_words, settling_words, throat_widths_told

__all__ = [
    "EXAMPLE",
    "Monitor",
    "Recipe",
    "Result",
    "Silent",
    "come_to_rest",
    "counting_words",
    "grow",
    "keeping_last_good",
    "make",
    "parse",
    "read",
    "run",
    "settling_words",
    "throat_widths_told",
    "varied",
    "with_images",
]
