"""Who touches whom: GraphML, a list of edges as CSV or Parquet, or lines for ParaView."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from exporters.check import check_name, check_positive, measured
from grainsdem.measures.graph.edges import check_edges, edges_content
from grainsdem.packing import contacts

if TYPE_CHECKING:
    from grainsdem.model import Packing


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactOptions:
    """What counts as a contact.

    Parameters
    ----------
    within : float, optional
        Largest gap [m] of a contact; by default that of `grainsdem.contacts`, 1e-3 of the mean diameter.
    walls : bool
        Whether the walls of the domain count as grains, with negative ids.

    Raises
    ------
    InputError
        If ``within`` is negative or not finite.
    """

    within: float | None = None
    walls: bool = False

    def __post_init__(self) -> None:
        if self.within is not None:
            check_positive("within", self.within, or_zero=True)


Options = ContactOptions

LOSES = ("Grains are known by their ids, and in GraphML by their positions; shapes and masses are not carried.",)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".graphml", options: ContactOptions | None = None
) -> dict[str, bytes]:
    """Return the one file, in SI, ids those of every other file.

    Raises
    ------
    InputError
        If the packing is empty or not finite.
    FileFormatError
        If contacts are not written under that suffix.
    MissingPackageError
        If PyArrow, which writes Parquet, is not installed.
    """
    check_name(name)
    check_edges(f"{name}{suffix}")
    measured(packing)
    options = options or ContactOptions()
    graph = contacts(packing, within=options.within, walls=options.walls)
    return {f"{name}{suffix}": edges_content(graph, suffix.lower(), packing=packing)}
