"""Tables of what moves the grains."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

from pydantic import ConfigDict, create_model, model_validator

from grainsdem.described import description
from grainsdem.dynamics.settle import settle
from grainsdem.recipe.base import Table
from grainsdem.values import Positive


class _Settling(Table):
    """What the table of settling checks besides each of its options."""

    model_config = ConfigDict(allow_inf_nan=False)

    if TYPE_CHECKING:
        start: str = "pour"
        spheres: bool = False
        drop_height: float | None = None
        overlap: float = 1e-3

    @model_validator(mode="after")
    def _start_suits(self) -> Self:
        if self.spheres and self.start == "place":
            raise ValueError("spheres overlap where grains stand in place; start must be 'pour' or 'rain'")
        if self.drop_height is not None and self.start != "rain":
            raise ValueError(f"drop_height needs start = 'rain'; got start = {self.start!r}")
        return self


def _fields() -> dict[str, Any]:
    """Return the options of settling, and what a recipe adds to them."""
    own = {name: (field.annotation, field) for name, field in description(settle).options.model_fields.items()}
    return {**own, "max_hours": (Positive, 24.0), "overlap": (Positive, 1e-3)}


if TYPE_CHECKING:

    class SettleTable(_Settling):
        """See below."""
else:
    SettleTable = create_model(
        "SettleTable",
        __base__=_Settling,
        __module__=__name__,
        __doc__="""``[settle]``: how the grains come to rest; leave the table out for a bed that is only grown.

        It has the options of `grainsdem.settle`; ``max_hours``, above which by estimate a run is refused; and
        ``overlap``, the largest overlap volume that the soft contacts may leave, relative to the smaller grain.
        """,
        **_fields(),
    )
