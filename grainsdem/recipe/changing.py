"""Recipes with other values for some of their keys, which are named by their path, such as ``seeds.count``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.options import explained
from grainsdem.recipe.tables import Recipe, make
from grainsdem.recipe.views.images import ImagesTable

if TYPE_CHECKING:
    from collections.abc import Mapping


@gated
def varied(recipe: Recipe, changes: Mapping[str, Any]) -> Recipe:
    """Return a recipe with other values for some keys.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    changes : mapping of str to Any
        Values by path; tables are dictionaries.

    Raises
    ------
    InputError
        If a key is unknown, a value out of range, or what results has no meaning; the message says what is allowed.
    """
    tables = recipe.model_dump(exclude_unset=True)
    for key, value in changes.items():
        put(tables, key, value)
    return make(**tables)


@gated
def with_images(recipe: Recipe, **changes: Any) -> Recipe:
    """Return a recipe whose table of images has other values for some keys.

    Raises
    ------
    InputError
        If a key is unknown or a value out of range; the message says what is allowed.
    """
    given = {} if recipe.images is None else recipe.images.model_dump(exclude_unset=True)
    try:
        table = ImagesTable.model_validate({**given, **changes})
    except ValidationError as error:
        raise InputError(f"images: {explained(error, lambda _path: ImagesTable)}") from error
    return recipe.model_copy(update={"images": table})


def put(tables: dict[str, Any], key: str, value: Any) -> None:
    """Set a value that is named by its path, such as ``seeds.count``.

    Raises
    ------
    InputError
        If the path leads through what is no table.
    """
    *folders, last = key.split(".")
    for name in folders:
        tables = tables.setdefault(name, {})
        if not isinstance(tables, dict):
            raise InputError(f"{key} cannot be varied: {name} is no table")
    tables[last] = value
