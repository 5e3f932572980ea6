"""What every table of a recipe stands on: a model that refuses unknown keys, and the kinds of numbers."""

from __future__ import annotations

from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, lt=1)]
Coefficient = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Table(BaseModel):
    """A table of a recipe: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_truth(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse true and false where numbers are meant: pydantic takes them for 1 and 0."""
        given = value if isinstance(value, list | tuple) else [value]
        kind = cls.model_fields[str(info.field_name)].annotation
        if any(isinstance(one, bool) for one in given) and _takes(kind, int, float) and not _takes(kind, bool, Any):
            raise ValueError("input should be a valid number")
        return value


def _takes(kind: Any, *wanted: Any) -> bool:
    """Return whether one of the types wanted is among what a type allows."""
    return kind in wanted or any(_takes(part, *wanted) for part in get_args(kind))


def flat(tables: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables as one, its keys joined by dots: TOML reads an unquoted ``seeds.count`` as a table."""
    found: dict[str, Any] = {}
    for key, value in tables.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found
