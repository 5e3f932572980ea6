"""No module imports itself, through however many others: a package and its own parts are no exception."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import exporters
import grainsdem

pytestmark = pytest.mark.unit


def imports(*packages):
    """Return which modules each module under some folders imports: for types and inside functions too."""
    files = {}
    for package in packages:
        for path in package.rglob("*.py"):
            parts = path.relative_to(package.parent).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    graph = {}
    for name, path in files.items():
        around = name.split(".") if path.stem == "__init__" else name.split(".")[:-1]
        found = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                above = around[: len(around) - node.level + 1] if node.level else []
                source = ".".join([*above, *([node.module] if node.module else [])])
                # A name is a part of the package where there is one of that name, else something in it.
                parts = {alias.name: f"{source}.{alias.name}" for alias in node.names}
                found |= {part if part in files else source for part in parts.values()}
        graph[name] = found & files.keys()
    return graph


def circle(graph):
    """Return the modules of a circle, or none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_module_is_part_of_a_circle_of_imports():
    graph = imports(*(Path(package.__file__).parent for package in (grainsdem, exporters)))
    assert {"grainsdem.model", "exporters.units"} <= graph["exporters.mjcf.grains"]
    assert not circle(graph)


@pytest.mark.parametrize(
    ("package", "part"),
    [
        ("from sand.heap import Heap", "from sand import Options"),
        ("from sand.heap import Heap", "def slide():\n    import sand"),
        ("from . import heap", "from . import Options"),
        ("from .heap import Heap", "if TYPE_CHECKING:\n    from sand import Options"),
    ],
)
def test_a_part_that_imports_its_package_is_found(tmp_path, package, part):
    folder = tmp_path / "sand"
    folder.mkdir()
    (folder / "__init__.py").write_text(package)
    (folder / "heap.py").write_text("from sand import grains")
    (folder / "grains.py").write_text("")
    assert not circle(imports(folder))
    (folder / "heap.py").write_text(part)
    assert set(circle(imports(folder))) == {"sand", "sand.heap"}
