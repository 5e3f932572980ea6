"""``[grains.axes]``: what proportions the grains have, in the mean or each its own, and how they lie."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from grainsdem.errors import InputError
from grainsdem.recipe.base import Table
from grainsdem.tessellation.forms import Forms, Orientation
from grainsdem.tessellation.metric import FLATTEST, Shape
from grainsdem.values import Positive

if TYPE_CHECKING:
    from grainsdem.tessellation.sized import Law

Zingg = Literal["blade", "rod", "disc", "spheroid"]
Angle = Annotated[float, Field(allow_inf_nan=False)]
Ratio = Annotated[float, Field(ge=FLATTEST, le=1)]


class RatioTable(Table):
    """A law of a ratio of axes, by number.

    Parameters
    ----------
    law : {"normal", "beta", "uniform"}
        Which; a normal law is cut at 0.2 and at 1, and ``mean`` and ``std`` are those before.
    mean, std : float
        Mean and standard deviation.
    """

    law: Literal["normal", "beta", "uniform"] = "normal"
    mean: Annotated[float, Field(gt=0, lt=1)]
    std: Positive

    @model_validator(mode="after")
    def _exists(self) -> Self:
        self.distribution()
        return self

    def distribution(self) -> Law:
        """Return the law as a distribution of scipy."""
        from scipy import stats  # noqa: PLC0415  (half a second, and only for laws)

        from grainsdem.tessellation.forms import LEAST  # noqa: PLC0415

        mean, std = self.mean, self.std
        if self.law == "uniform":
            return stats.uniform(mean - 3**0.5 * std, 12**0.5 * std)
        if self.law == "normal":
            return stats.truncnorm((LEAST - mean) / std, (1 - mean) / std, mean, std)
        both = mean * (1 - mean) / std**2 - 1
        if both <= 0:
            raise ValueError(f"there is no beta law of mean {mean:g} and std {std:g}")
        return stats.beta(mean * both, (1 - mean) * both)


def _kind(value: object) -> str:
    return "dict[law]" if isinstance(value, dict | RatioTable) else "float"


RatioOrLaw = Annotated[Annotated[Ratio, Tag("float")] | Annotated[RatioTable, Tag("dict[law]")], Discriminator(_kind)]
"""A number, or a table: with tags, which the lines that errors are told in leave out, only one is tried."""


class AxesTable(Table):
    """``[grains.axes]``: proportions of the grains, and how they lie.

    One number each is the mean of all, had by one stretch of space. Classes, laws, an orientation or a spread give each
    grain a form of its own; cells then leave a little void between them.

    Parameters
    ----------
    elongation, flatness : float or table, optional
        b/a and c/b, of the edges of each grain's smallest box with a side on one of its faces, a >= b >= c; one of them
        or both. A number is had as the mean within 2 %; grains are as equant as they grow, or less. A table is a law,
        such as ``{law = "beta", mean = 0.7, std = 0.1}``, see `RatioTable`.
    classes : table of numbers, optional
        Instead of ratios: shares by number of Zingg's classes, such as ``{disc = 0.3, spheroid = 0.4, blade = 0.1,
        rod = 0.2}``, of sum one, each had within 5 % of itself.
    orientation : {"uniform", "aligned"}, optional
        Whether grains of forms of their own lie any way, as by default, or about one.
    spread : float, optional
        Standard deviation [rad] of the turns about each axis that part aligned grains from the way that they lie about.
    trend : float
        Direction [rad] of the long axes in the plane, counter-clockwise from +x.
    dip : float
        Imbrication [rad]: by how much the flat sides are turned up about the middle axes, the end of the long axis that
        points along the trend raised.
    """

    elongation: RatioOrLaw | None = None
    flatness: RatioOrLaw | None = None
    classes: dict[Zingg, Annotated[float, Field(ge=0, le=1)]] | None = None
    orientation: Orientation | None = None
    spread: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    trend: Angle = 0.0
    dip: Angle = 0.0

    @model_validator(mode="after")
    def _has_a_form(self) -> Self:
        if self.elongation is None and self.flatness is None and self.classes is None:
            raise ValueError("give elongation, flatness or both, or classes")
        if self.is_mixed:
            try:
                self.forms()
            except InputError as error:
                raise ValueError(str(error)) from error
        return self

    @property
    def is_mixed(self) -> bool:
        """Whether each grain has a form of its own."""
        is_law = isinstance(self.elongation, RatioTable) or isinstance(self.flatness, RatioTable)
        return is_law or any(value is not None for value in (self.classes, self.orientation, self.spread))

    def shape(self) -> Shape:
        """Return the mean proportions asked for; none is a law."""
        return Shape(self.elongation, self.flatness, self.trend, self.dip)  # type: ignore[arg-type]

    def forms(self) -> Forms:
        """Return the forms asked for."""
        low, high = (_taken(value) for value in (self.elongation, self.flatness))
        is_turned = bool(self.spread is not None or self.trend or self.dip)
        lies = self.orientation or ("aligned" if is_turned else "uniform")
        shares = None if self.classes is None else {str(name): share for name, share in self.classes.items()}
        return Forms(shares, low, high, lies, self.spread or 0.0, self.trend, self.dip)


def _taken(value: float | RatioTable | None) -> float | Law | None:
    return value.distribution() if isinstance(value, RatioTable) else value
