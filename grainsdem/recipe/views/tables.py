"""The tables of what looks into a bed: ``[voxels]``, ``[section]`` and ``[planform]``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import ConfigDict, Field, create_model, model_validator

from grainsdem.measures.planform.photographs import camera_options
from grainsdem.recipe.base import Table
from grainsdem.values import Positive


class ViewTable(Table):
    """A table of what looks into a bed."""


class VoxelsTable(ViewTable):
    """``[voxels]``: which grain each voxel of the domain lies in.

    Parameters
    ----------
    size : float, optional
        Edge [m] of a voxel.
    per_diameter : float, optional
        Voxels along a mean diameter, 20 by default; instead of ``size``.
    formats : list of str
        Among ``"vti"``, ``"npy"``, ``"tif"``, ``"nrrd"`` and ``"raw"``.
    phase : bool
        Whether 1 is written in grains and 0 elsewhere, not which grain.
    """

    size: Positive | None = None
    per_diameter: Positive | None = None
    formats: tuple[Literal["vti", "npy", "tif", "nrrd", "raw"], ...] = ("vti",)
    phase: bool = False

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.size is not None and self.per_diameter is not None:
            raise ValueError(f"give size or per_diameter, not both; got {self.size} and {self.per_diameter}")
        return self


class SectionTable(ViewTable):
    """``[section]``: the polygons in which a level plane cuts the bed, and how sections change along an axis.

    Parameters
    ----------
    axis : {"x", "y", "z"}
        Normal of the plane.
    at : float
        Where it is, from 0 at the lower end of the bed along the axis to 1 at the upper.
    levels : int
        Levels of the profile along the axis; 0 for none.
    """

    axis: Literal["x", "y", "z"] = "z"
    at: Annotated[float, Field(ge=0, le=1)] = 0.5
    levels: Annotated[int, Field(ge=0)] = 32


class _Planform(ViewTable):
    """What the table of planforms has besides the options of the photograph."""

    model_config = ConfigDict(allow_inf_nan=False)

    pixel: Positive | None = None
    per_diameter: Positive | None = None
    formats: tuple[Literal["png", "npy", "tif"], ...] = ("png", "npy")
    least_pixels: Annotated[int, Field(ge=1)] = 1

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.pixel is not None and self.per_diameter is not None:
            raise ValueError(f"give pixel or per_diameter, not both; got {self.pixel} and {self.per_diameter}")
        return self

    def camera(self) -> dict[str, object]:
        """Return the options of the photograph."""
        return self.model_dump(include=set(camera_options().model_fields))


if TYPE_CHECKING:

    class PlanformTable(_Planform):
        """See below."""
else:
    PlanformTable = create_model(
        "PlanformTable",
        __base__=_Planform,
        __module__=__name__,
        __doc__="""``[planform]``: a photograph of the bed from above, and the truth about it.

        It has the options of `grainsdem.photograph`; ``pixel``, the edge [m] of a pixel, or ``per_diameter``, pixels
        along a mean diameter, 20 by default; ``formats``, among ``"png"``, ``"npy"`` and ``"tif"``; and
        ``least_pixels``: grains of which fewer are seen are left out of the bias.
        """,
        **{name: (field.annotation, field) for name, field in camera_options().model_fields.items()},
    )
