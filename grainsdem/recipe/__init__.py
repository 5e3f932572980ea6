"""A bed described in a TOML file, read into a typed model, and the chain that makes it."""

from grainsdem.recipe.chain import (
    Monitor,
    Result,
    Silent,
    counting_words,
    grow,
    keeping_last_good,
    run,
    settling_words,
)
from grainsdem.recipe.tables import EXAMPLE, Recipe, make, parse, read

__all__ = [
    "EXAMPLE",
    "Monitor",
    "Recipe",
    "Result",
    "Silent",
    "counting_words",
    "grow",
    "keeping_last_good",
    "make",
    "parse",
    "read",
    "run",
    "settling_words",
]
