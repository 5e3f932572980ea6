"""The contact graph as a file: a table of edges in text or Parquet, GraphML, or lines for ParaView."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from xml.sax.saxutils import quoteattr

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError, MissingPackageError, ShapeError
from grainsdem.gate import gated

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import ContactGraph, Packing

    Arrays = Mapping[str, NDArray[Any]]

Columns: TypeAlias = "Mapping[str, ArrayLike]"

COLUMNS = ("i", "j", "gap", "area", "nx", "ny", "nz", "x", "y", "z", "kind")

SUFFIXES = (".csv", ".parquet", ".graphml", ".vtp")


@gated
def write_edges(
    graph: ContactGraph,
    path: str | os.PathLike[str],
    *,
    packing: Packing | None = None,
    columns: Columns | None = None,
) -> Path:
    """Write the contacts as a file, in SI, under the grains' own ids; walls have negative ones.

    Parameters
    ----------
    graph : ContactGraph
        Who touches whom.
    path : str or path-like
        ``.csv``: one row a contact. ``.parquet``: the same table with the columns' own types, for pandas, Polars and
        DuckDB. ``.graphml``: all grains as nodes, for networkx, Gephi and igraph. ``.vtp``: lines between centroids,
        for ParaView.
    packing : Packing, optional
        Where the grains are; needed for ``.vtp``, and their positions are nodes' attributes in ``.graphml``. Where
        grains have classes, those of both ends are columns, ``class_i`` and ``class_j``, -1 for a wall.
    columns : mapping of str to array_like, optional
        More of each contact, such as its force: numbers, shape (m,), or vectors, shape (m, 3), which tables have as
        three columns that end in ``_x``, ``_y`` and ``_z``.

    Returns
    -------
    Path
        What was written.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    ShapeError
        If the packing is missing where it is needed or has another number of grains, or a column of rows.
    MissingPackageError
        If PyArrow, which writes Parquet, is not installed.
    """
    path = check_edges(path)
    content = edges_content(graph, path.suffix.lower(), packing=packing, columns=columns)
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return path


def edges_content(
    graph: ContactGraph, suffix: str, *, packing: Packing | None = None, columns: Columns | None = None
) -> bytes:
    """Return what `write_edges` writes to a file of one of `SUFFIXES`; it raises the same errors."""
    if packing is not None and len(packing) != graph.n_grains:
        raise ShapeError(f"the packing must have the graph's {graph.n_grains} grains; got {len(packing)}")
    more = {name: np.asarray(values) for name, values in (columns or {}).items()}
    for name, values in more.items():
        if values.shape not in ((len(graph),), (len(graph), 3)):
            raise ShapeError(f"{name} must be of shape ({len(graph)},) or ({len(graph)}, 3); got {values.shape}")
    if packing is not None and packing.classes is not None:
        more = {**_ends(graph, packing.classes), **more}
    if suffix == ".vtp":
        if packing is None:
            raise ShapeError("lines between grains need packing=: the graph does not know where the grains are")
        return _vtp(graph, packing, more).encode()
    flat = {
        name if row is values else f"{name}_{axis}": row
        for name, values in more.items()
        for axis, row in zip("xyz", values.T if values.ndim == 2 else [values], strict=False)
    }
    if suffix == ".parquet":
        return _parquet(graph, flat)
    return (_csv(graph, flat) if suffix == ".csv" else _graphml(graph, packing, flat)).encode()


def _ends(graph: ContactGraph, classes: NDArray[np.int32]) -> dict[str, NDArray[Any]]:
    """Return the class of the grain at each end of a contact; a wall's is -1."""
    return {
        f"class_{end}": np.where(ids >= 0, classes[np.maximum(ids, 0)], -1).astype(np.int64)
        for end, ids in zip("ij", graph.pairs.T, strict=True)
    }


def check_edges(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file of contacts, or raise `FileFormatError` where its suffix is not one of `SUFFIXES`."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        allowed = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
        raise FileFormatError(f"{path}: contacts are written as {allowed}; got {path.suffix!r}")
    return path


def _rows(graph: ContactGraph, more: Arrays) -> list[tuple[object, ...]]:
    """Return one tuple of `COLUMNS`, and what there is more, a contact."""
    numbers = np.column_stack([graph.gaps, graph.areas, graph.normals, graph.points]).tolist()
    rest = list(zip(*(values.tolist() for values in more.values()), strict=True)) if more else [()] * len(graph)
    parts = zip(graph.pairs.tolist(), numbers, graph.kinds(), rest, strict=True)
    return [(*pair, *row, kind, *others) for pair, row, kind, others in parts]


def _csv(graph: ContactGraph, more: Arrays) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, *more])
    writer.writerows(_rows(graph, more))
    return text.getvalue()


def _parquet(graph: ContactGraph, more: Arrays) -> bytes:
    """Return the table of `COLUMNS` and what there is more as Parquet, the same bytes for the same contacts."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise MissingPackageError('Parquet needs PyArrow: pip install "grainsdem[tables]"') from error
    numbers = (*graph.pairs.T, graph.gaps, graph.areas, *graph.normals.T, *graph.points.T)
    columns = {name: np.ascontiguousarray(values) for name, values in zip(COLUMNS[:-1], numbers, strict=True)}
    kinds = pa.array(graph.kinds(), pa.string()).dictionary_encode()
    sink = io.BytesIO()
    units = {"units": "SI: gap, x, y, z in m, area in m²; normal from i to j; walls have negative ids"}
    rest = {name: np.ascontiguousarray(values) for name, values in more.items()}
    parquet.write_table(pa.table({**columns, COLUMNS[-1]: kinds, **rest}, metadata=units), sink, compression="zstd")
    return sink.getvalue()


def _graphml(graph: ContactGraph, packing: Packing | None, more: Arrays) -> str:
    names = [*COLUMNS[2:], *more]
    classes = None if packing is None else packing.classes
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">',
        *(
            f'<key id="{name}" for="edge" attr.name="{name}" attr.type="{"string" if name == "kind" else "double"}"/>'
            for name in names
        ),
        *(f'<key id="p{axis}" for="node" attr.name="{axis}" attr.type="double"/>' for axis in "xyz"),
        *([] if classes is None else ['<key id="pclass" for="node" attr.name="class" attr.type="long"/>']),
        '<graph edgedefault="undirected">',
    ]
    walls = np.unique(graph.pairs[graph.is_wall, 0]).tolist()
    places = np.empty((graph.n_grains, 0)) if packing is None else packing.positions
    for grain, place in enumerate(places.tolist()):
        data = "".join(f'<data key="p{a}">{v!r}</data>' for a, v in zip("xyz", place, strict=False))
        data += "" if classes is None else f'<data key="pclass">{classes[grain]}</data>'
        lines.append(f'<node id="{grain}">{data}</node>')
    lines += [f'<node id="{wall}"/>' for wall in walls]
    for i, j, *values in _rows(graph, more):
        data = "".join(f'<data key="{n}">{v}</data>' for n, v in zip(names, values, strict=True))
        lines.append(f"<edge source={quoteattr(str(i))} target={quoteattr(str(j))}>{data}</edge>")
    return "\n".join([*lines, "</graph>", "</graphml>", ""])


def _vtp(graph: ContactGraph, packing: Packing, more: Arrays) -> str:
    """Return lines from centroid to centroid, by way of the contact; from the wall's foot where one end is a wall."""
    i, j = graph.pairs.T
    there = packing.positions[j] + graph.shifts * packing.domain.lengths
    here = np.where(graph.is_wall[:, None], graph.ends[:, 0], packing.positions[np.maximum(i, 0)])
    points = np.stack([here, graph.points, there], axis=1).reshape(-1, 3)
    m = len(graph)
    others = 'NumberOfVerts="0" NumberOfStrips="0" NumberOfPolys="0"'

    def array(name: str, kind: str, values: np.ndarray, width: int = 1) -> str:
        body = " ".join(map(repr, np.ravel(values).tolist()))
        return f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="ascii">{body}</DataArray>'

    return "\n".join(
        [
            '<?xml version="1.0"?>',
            '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64"><PolyData>',
            f'<Piece NumberOfPoints="{3 * m}" NumberOfLines="{m}" {others}>',
            f"<Points>{array('Points', 'Float64', points, 3)}</Points>",
            "<Lines>",
            array("connectivity", "Int64", np.arange(3 * m)),
            array("offsets", "Int64", 3 * np.arange(1, m + 1)),
            "</Lines>",
            "<CellData>",
            array("i", "Int64", i),
            array("j", "Int64", j),
            array("gap", "Float64", graph.gaps),
            array("area", "Float64", graph.areas),
            array("normal", "Float64", graph.normals, 3),
            *(
                array(name, "Int64" if values.dtype.kind in "iu" else "Float64", values, values[:1].size)
                for name, values in more.items()
            ),
            "</CellData>",
            "</Piece></PolyData></VTKFile>",
            "",
        ]
    )
