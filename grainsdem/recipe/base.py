"""What every table of a recipe stands on: a model that refuses unknown keys, and the kinds of numbers."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from grainsdem.values import held_numbers

Fraction = Annotated[float, Field(ge=0, lt=1)]


class Table(BaseModel):
    """A table of a recipe: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Hold all numbers: a yes or a text is none."""
        return held_numbers(handler(source))


def flat(tables: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables as one, its keys joined by dots: TOML reads an unquoted ``seeds.count`` as a table."""
    found: dict[str, Any] = {}
    for key, value in tables.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found
