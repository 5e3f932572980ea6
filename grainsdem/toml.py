"""TOML as it comes from users: what Python's own reader breaks on is one line, too."""

from __future__ import annotations

import tomllib
from typing import Any

from grainsdem.errors import FileFormatError

DEEPEST = 50
"""Tables and lists within one another: recipes need five, and what reads them goes down by itself."""


def read_toml(text: str) -> dict[str, Any]:
    r"""Return the tables of a text.

    Raises
    ------
    FileFormatError
        If it is not TOML, a number has thousands of digits, or tables or lists lie too deep within one another.

    Examples
    --------
    >>> read_toml("[seeds]\ncount = 8\n")
    {'seeds': {'count': 8}}
    """
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise FileFormatError(_TOO_DEEP) from None
    except ValueError as error:  # of a number of thousands of digits it is Python's own
        raise FileFormatError(f"not TOML: {' '.join(str(error).split())}") from error
    level: list[Any] = [tables]
    for _ in range(DEEPEST):
        level = [inner for item in level for inner in _within(item)]
        if not level:
            return tables
    raise FileFormatError(_TOO_DEEP)


_TOO_DEEP = f"not TOML that can be read: more than {DEEPEST} tables or lists within one another"


def _within(item: Any) -> list[Any]:
    """Return the tables and lists that a table or list holds."""
    inner = item.values() if isinstance(item, dict) else item
    return [value for value in inner if isinstance(value, dict | list)]
