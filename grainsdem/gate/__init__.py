"""The door of every public function: what is given is held against what its signature says, before anything is done.

A signature says of each argument what it may be, in the words of types; `gated` reads them once, and holds each call
against them. Numbers of other kinds become those of Python, and what an array can be made of becomes one; None, text,
complex numbers, ragged lists and nouns of another kind end in one line. Shapes of arrays are those of the docstring:
``(m, 3)`` beside ``(m,)`` is as many of one as of the other. What neither can say, such as a range, is the function's
own business, which need not ask again what kind of thing it has.
"""

from grainsdem.gate.door import gated, gated_noun
from grainsdem.gate.shapes import shapes_of
from grainsdem.gate.types import checks_of

__all__ = ["checks_of", "gated", "gated_noun", "shapes_of"]
