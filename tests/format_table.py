"""The table of docs/formats.md: which program opened which format, in which version, and what was done with it there.

Tests that open a file in the program that it is for say so by the marker `opens`. With ``GRAINSDEM_LEDGER`` set to a
path, pytest notes there what passed; ``python tests/format_table.py LEDGER`` puts it, with versions and the date, into
`docs/clients.json` and makes the table from that.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE, KEPT = ROOT / "docs" / "formats.md", ROOT / "docs" / "clients.json"
BEGIN, END = "<!-- made by tests/format_table.py -->\n", "<!-- until here -->\n"

DONE = ("opened", "counted", "weighed", "meshed", "stepped", "at rest", "part of another scene")
"""What can be done with a file, in the order in which it is told."""

PACKAGES = {
    "MuJoCo": "mujoco", "OpenUSD": "usd-core", "trimesh": "trimesh", "VTK": "vtk", "meshio": "meshio",
    "lib3mf": "lib3mf", "pandas": "pandas", "networkx": "networkx", "Drake": "drake", "PyBullet": "pybullet",
}  # fmt: skip
"""Clients that are packages beside us."""

APART = {
    "MuJoCo 3.17": ("newton", "mujoco"), "MuJoCo Warp": ("newton", "mujoco_warp"), "Newton": ("newton", "newton"),
    "Newton, XPBD": ("newton", "newton"), "NVIDIA's validator": ("newton", "omniverse_asset_validator"),
    "PhysX": ("physx", "ovphysx"),
}  # fmt: skip
"""Clients in environments of their own: the environment, and the package."""

PROGRAMS = {
    "Gmsh": (["gmsh", "--version"], r"(\d[\d.]*)"),
    "LAMMPS": (["lmp", "-h"], r"Simulator - (\d+ \w+ \d+)"),
    "Yade": (["yade", "--version"], r"(\d[\w.]*)"),
    "Gazebo's parser": (["ign", "sdf", "--versions"], r"(\d[\d.]*)"),
    "OpenFOAM": (["dpkg-query", "-W", "openfoam"], r"\t(\d+)"),
}
"""Programs: how they are asked for their version, and where it stands in what they say."""

NOT_RUN = {
    "usd": "Isaac Sim, Omniverse, Blender", "sdf": "Gazebo", "glb": "Blender, browsers", "rockable": "Rockable, exaDEM",
    "3dec": "3DEC",
}  # fmt: skip
"""Programs that a format is for and that no test could run."""


def version(client: str) -> str:
    """Return the version of a client that is installed here."""
    if client in PACKAGES:
        return metadata.version(PACKAGES[client])
    if client in APART:
        environment, package = APART[client]
        found = (ROOT / ".environments").glob(f"{environment}-*/lib/python*/site-packages/{package}-*.dist-info")
        name = max(found, key=lambda path: path.stat().st_mtime).name
        return name.removesuffix(".dist-info").split("-")[1]
    command, pattern = PROGRAMS[client]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    said = re.search(pattern, run.stdout + run.stderr)
    return next(part for part in said.groups() if part) if said else "of an unknown version"


def kept(ledger: Path) -> dict[str, object]:
    """Return what is kept of a ledger: the date, and rows of format, client, version and what was done."""
    found: dict[tuple[str, str], set[str]] = {}
    for line in ledger.read_text(encoding="utf-8").splitlines():
        format_, client, *done = json.loads(line)
        found.setdefault((format_, client), set()).update(done, ["opened"])
    rows = [[*key, version(key[1]), *sorted(found[key], key=DONE.index)] for key in sorted(found)]
    return {"date": datetime.now(tz=UTC).date().isoformat(), "rows": rows}


def table(told: dict[str, object]) -> str:
    """Return the table, and what could not be run below it."""
    lines = ["| format | program | version | what tests did with it there |", "|---|---|---|---|"]
    for format_, client, number, *done in told["rows"]:
        name = client.removesuffix(f" {number.rpartition('.')[0]}")
        lines.append(f"| `{format_}` | {name} | {number} | {', '.join(done)} |")
    lines += [f"| `{format_}` | {clients} | | **not run** |" for format_, clients in NOT_RUN.items()]
    return "\n".join([*lines, "", f"As of {told['date']}, when all of them passed.", ""])


def page(told: dict[str, object]) -> str:
    """Return the page with its table made anew."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    return before + BEGIN + "\n" + table(told) + "\n" + END + rest.partition(END)[2]


def main(ledger: str) -> None:
    told = kept(Path(ledger))
    KEPT.write_text(json.dumps(told, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    PAGE.write_text(page(told), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
