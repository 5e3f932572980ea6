"""The table ``[images]``: what differs from photograph to photograph of a set, drawn from ranges."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self, get_args, get_origin

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    create_model,
    model_validator,
)

from grainsdem.measures.planform.camera.colors import mixture
from grainsdem.measures.planform.photographs import camera_options
from grainsdem.options import checked
from grainsdem.recipe.base import Table, flat
from grainsdem.values import Positive, number

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from pydantic.fields import FieldInfo


def _ranged(kind: Any, unit: str = "") -> Any:
    """Return the annotation of a number of a kind, or of a range of such numbers."""
    one = TypeAdapter(kind)

    def check(given: Any) -> Any:
        is_range = isinstance(given, list | tuple) and len(given) == 2
        try:
            ends = tuple(one.validate_python(number(end)) for end in (given if is_range else [given]))
        except ValueError as error:
            told = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
            wrong = told[6:] if told[:6].lower() == "input " else told
            of = f" of {unit}" if unit else ""
            raise ValueError(f"a number or a range [low, high]{of}, each of which {wrong}") from error
        if is_range and ends[0] > ends[1]:
            raise ValueError("a range goes from its lower to its upper end")
        return ends if is_range else ends[0]

    return Annotated[Any, AfterValidator(check)]


def _choices(given: Any) -> Any:
    """Return mixtures of colours, of which each bed has one, from one or from a list of several."""
    if given is None:
        return None
    is_list = isinstance(given, list | tuple) and bool(given)
    several = is_list and all(not isinstance(item, list | tuple) or _is_rows(item) for item in given)
    return tuple(mixture(item) for item in given) if several else (mixture(given),)


def _is_rows(given: Any) -> bool:
    """Return whether it is a mixture of one's own: a list of rows."""
    return bool(given) and all(isinstance(row, list | tuple) for row in given)


Size = Annotated[int, Field(ge=1, le=1 << 15)]
Azimuth = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi, allow_inf_nan=False)]
Elevation = Annotated[float, Field(gt=0, le=math.pi / 2, allow_inf_nan=False)]
Row = tuple[float, float, float, float]
Mixture = dict[str, float] | tuple[Row, ...]


def _varied(given: Any) -> Any:
    """Return what is varied by its path, or raise where a key has neither a range nor a list of values."""
    keys = flat(given) if isinstance(given, dict) else None
    if keys is None or any(not isinstance(values, list | tuple) or not values for values in keys.values()):
        raise ValueError("each key has a range [low, high] of numbers, or a list of values that are drawn from")
    upside_down = [key for key, values in keys.items() if _is_range(values) and values[0] > values[1]]
    if upside_down:
        raise ValueError(f"a range goes from its lower to its upper end; {upside_down[0]} does not")
    return {key: tuple(values) for key, values in keys.items()}


def _is_range(values: Any) -> bool:
    return len(values) == 2 and all(isinstance(end, int | float) and not isinstance(end, bool) for end in values)


class _Images(Table):
    """What a set of images has besides the ranges of the photograph's options."""

    model_config = ConfigDict(allow_inf_nan=False)

    size: tuple[Size, Size] = (512, 512)
    pixel: _ranged(Positive | None, "m") = None  # type: ignore[valid-type]
    per_diameter: _ranged(Positive | None) = None  # type: ignore[valid-type]
    per_bed: Annotated[int, Field(ge=1)] = 1
    vary: Annotated[dict[str, tuple[Any, ...]], BeforeValidator(_varied)] = {}  # noqa: RUF012  (pydantic copies it)
    stones: Annotated[int, Field(ge=1)] = 100
    least_pixels: Annotated[int, Field(ge=1)] = 1
    formats: Annotated[tuple[Literal["png", "npy", "tif"], ...], Field(min_length=1)] = ("png",)
    labels: tuple[Literal["png", "npy", "tif"], ...] = ()
    grains: tuple[Literal["csv", "parquet", "h5"], ...] = ()
    tables: tuple[Literal["parquet", "h5"], ...] = ()
    shaded: Annotated[float, Field(ge=0, le=1)] = 1.0
    light_azimuth: _ranged(Azimuth | None, "rad") = None  # type: ignore[valid-type]
    light_elevation: _ranged(Elevation | None, "rad") = None  # type: ignore[valid-type]

    if TYPE_CHECKING:
        light: Any = None

    @model_validator(mode="after")
    def _said_once(self) -> Self:
        if self.pixel is not None and self.per_diameter is not None:
            raise ValueError(f"give pixel or per_diameter, not both; got {self.pixel} and {self.per_diameter}")
        if self.light is not None and (self.light_azimuth is not None or self.light_elevation is not None):
            raise ValueError("give light, or light_azimuth and light_elevation; got both")
        return self

    @model_validator(mode="after")
    def _ends_are_allowed(self) -> Self:
        """Vectors are checked at the ends of all their ranges: what is allowed there is allowed in between."""
        for name in _VECTORS:
            given = getattr(self, name)
            for end in itertools.product(*map(_ends, given)) if given is not None else ():
                checked(camera_options(), {name: end})
        return self

    def draw_bed(self, rng: np.random.Generator) -> dict[str, Any]:
        """Return values of the keys that are varied from bed to bed, by their paths."""
        drawn: dict[str, Any] = {}
        for key, values in self.vary.items():
            share = rng.random()
            if not _is_range(values):
                drawn[key] = values[int(share * len(values))]
            elif all(isinstance(end, int) for end in values):
                drawn[key] = values[0] + int(share * (values[1] - values[0] + 1))
            else:
                drawn[key] = _between(tuple(values), share)
        return drawn

    def draw(self, rng: np.random.Generator) -> Draw:
        """Return what one photograph is taken with: each number from its range, all values of it alike likely.

        What a key says changes no other key's numbers.
        """
        places = (rng.random(), rng.random())
        size, is_shaded = rng.random(), rng.random() < self.shaded
        camera: dict[str, Any] = {}
        turn, rise = (_LIGHT[name] if getattr(self, name) is None else getattr(self, name) for name in _LIGHT)
        azimuth, elevation = _between(turn, rng.random()), _between(rise, rng.random())
        for name in camera_options().model_fields:
            given = getattr(self, name)
            shares = rng.random(_SLOTS)
            if name in _VECTORS:
                camera[name] = None if given is None else [_between(*pair) for pair in zip(given, shares, strict=False)]
            elif name == "colors":
                camera[name] = None if given is None else given[int(shares[0] * len(given))]
            elif name == "wet":
                camera[name] = bool(shares[0] < given)
            else:
                camera[name] = None if given is None else _between(given, shares[0])
        if not is_shaded:
            camera["shadow"] = 0.0
        if camera["light"] is None:
            flat = math.cos(elevation)
            camera["light"] = [flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)]
        scale = self.pixel or self.per_diameter
        return Draw(camera, places, None if scale is None else _between(scale, size))


class Draw(NamedTuple):
    """What one photograph is taken with.

    Parameters
    ----------
    camera : dict of str to Any
        Options of the photograph.
    places : tuple of float
        Where in the bed the picture lies along x and y: from 0, at its lower end, to 1.
    scale : float or None
        The table's ``pixel`` [m] or ``per_diameter``, whichever it has.
    """

    camera: dict[str, Any]
    places: tuple[float, float]
    scale: float | None


_SLOTS = 3
"""Numbers drawn for each option, needed or not: those of a direction."""

_LIGHT = {"light_azimuth": (0.0, 2 * math.pi), "light_elevation": (0.5, 1.2)}
"""Where light comes from unless the table says: from all around, neither grazing nor from straight above."""

_RANGED = {"blur": (0.3, 1.0), "noise": (0.0, 0.02)}
"""Ranges of what no camera is without; the other options are those of `photograph` where none is given."""

_VECTORS = ("light", "gradient", "lens")


def _ends(given: Any) -> tuple[float, ...]:
    return given if isinstance(given, tuple) else (given,)


def _between(given: Any, share: float) -> float:
    low, high = given if isinstance(given, tuple) else (given, given)
    return float(low + share * (high - low))


def _field(name: str, field: FieldInfo) -> tuple[Any, Any]:
    """Return the type and the default of an option's range."""
    default = _RANGED.get(name, field.default)
    if name == "colors":
        return Annotated[tuple[Mixture, ...] | None, BeforeValidator(_choices)], None
    if name == "wet":
        return Annotated[float, Field(ge=0, le=1)], float(default)
    kinds = [kind for kind in get_args(field.annotation) if kind is not type(None)]
    if get_origin(field.annotation) is tuple:
        each = tuple(_ranged(Annotated[float, Field(allow_inf_nan=False)]) for _ in kinds)
        return (tuple[each] | None, None) if name == "light" else (tuple[each], default)  # type: ignore[valid-type]
    number: Any = Annotated[(float, *field.metadata, Field(allow_inf_nan=False))]
    return _ranged(number | None if kinds else number), default


def _fields() -> Mapping[str, tuple[Any, Any]]:
    return {name: _field(name, field) for name, field in camera_options().model_fields.items()}


if TYPE_CHECKING:

    class ImagesTable(_Images):
        """See below."""
else:
    ImagesTable = create_model(
        "ImagesTable",
        __base__=_Images,
        __module__=__name__,
        __doc__="""``[images]``: a set of photographs of beds, what differs among them drawn from ranges.

        Parameters
        ----------
        size : list of int
            Columns and rows of pixels, 512 by 512 by default.
        pixel : float or range, optional
            Edge [m] of a pixel. The picture lies anywhere in the bed; by default it fills it along one axis.
        per_diameter : float or range, optional
            Pixels along a mean diameter, instead of ``pixel``.
        per_bed : int
            Photographs of each bed.
        vary : table
            Keys of the recipe that differ from bed to bed, such as ``seeds.spread = [0.02, 0.1]``: two numbers are a
            range, of whole ones where both are; else a list of values, which may be words or tables, is drawn from.
        stones : int
            Points of the grid by which stones are counted on each picture, as for `grainsdem.pebble_count`.
        least_pixels : int
            Grains of which fewer are seen are left out of the percentiles of what is seen.
        formats, labels : list of str
            What images, and labels of their pixels, are written as: ``"png"``, ``"npy"`` and ``"tif"``; no labels by
            default.
        grains : list of str
            What tables of the grains of each image are written as: ``"csv"``, ``"parquet"``, ``"h5"``; none by default.
        tables : list of str
            What the table of the set is written as besides CSV: ``"parquet"``, ``"h5"``.
        shaded : float
            Share of the photographs that the shadow of something outside falls on, where there is any.
        light_azimuth, light_elevation : float or range, optional
            Where the light comes from [rad]: counter-clockwise from +x, anywhere by default, and above the horizon.

        Notes
        -----
        Besides, every option of `grainsdem.photograph`: a number, or a range ``[low, high]`` that it is drawn from; for
        each number of a vector, one or the other; ``wet``, a probability; ``colors``, one mixture or a list of those
        that are drawn from.
        """,
        **_fields(),
    )
