"""One row a grain: every measure of `grainsdem.table`, as CSV, Parquet or HDF5."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from exporters.check import check_name, measured
from grainsdem.measures import table
from grainsdem.measures.grains.files import check_table, table_content

if TYPE_CHECKING:
    from grainsdem.model import Packing


@dataclass(frozen=True, slots=True, kw_only=True)
class GrainTableOptions:
    """Nothing to choose: the columns are those of `grainsdem.table`, in SI."""


Options = GrainTableOptions

LOSES = ("Shapes and orientations are not carried: see the columns.",)
"""What the format does not carry."""


def files(
    packing: Packing,
    *,
    name: str = "bed",
    suffix: str = ".csv",
    options: GrainTableOptions | None = None,  # noqa: ARG001  (the contract of formats)
) -> dict[str, bytes]:
    """Return the one file; Parquet and HDF5 know the columns' units.

    Raises
    ------
    InputError
        If the packing is empty or not finite.
    FileFormatError
        If a table is not written under that suffix.
    MissingPackageError
        If PyArrow, which writes Parquet, is not installed.
    """
    check_name(name)
    check_table(f"{name}{suffix}")
    measured(packing)
    return {f"{name}{suffix}": table_content(table(packing), suffix.lower())}
