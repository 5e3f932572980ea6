"""The programs that files are for: the format and options that suit each, and the lines that open a file there."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.formats import FORMATS, find, shared
from exporters.rest import time_step
from grainsdem.errors import InputError, shown
from grainsdem.gate import gated
from grainsdem.geometry.integrals import volumes
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from collections.abc import Mapping

    from grainsdem.model import Packing

GRAVITY = 9.81

_CONTACTS = 20
"""Contact points of a grain that room is made for where a program asks how much: beds at rest have three to six."""


@dataclass(frozen=True, slots=True)
class Program:
    """A program that a bed is for.

    Parameters
    ----------
    format, suffix : str
        Name of the format, and suffix of the file; none of a folder.
    lines : str
        What opens it there. ``{file}``, ``{folder}``, ``{name}`` and ``{stem}`` stand for the path, its
        folder, its name and that without suffix; ``{step}`` for the time step
        and ``{gravity}`` for gravity in units of the file; ``{contacts}`` and ``{rows}`` for as many contacts, and rows
        of constraints, as a bed may have.
    options : dict
        Options of the format, where they are not as by default.
    """

    format: str
    suffix: str
    lines: str
    options: dict[str, Any] = field(default_factory=dict)


PROGRAMS = {
    "mujoco": Program("mjcf", ".xml", """\
model = mujoco.MjModel.from_xml_path("{file}")
data = mujoco.MjData(model)
mujoco.mj_step(model, data)"""),
    "mjwarp": Program("mjcf", ".xml", """\
model = mujoco.MjModel.from_xml_path("{file}"); data = mujoco.MjData(model); mujoco.mj_forward(model, data)
m, d = mujoco_warp.put_model(model), mujoco_warp.put_data(model, data, nconmax={contacts}, njmax={rows})
mujoco_warp.step(m, d)""", {"solver": "Newton", "noslip_iterations": 0, "autoreset": True}),
    "newton": Program("usd", ".usdc", """\
builder = newton.ModelBuilder(); newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
step = builder.add_usd("{file}")["physics_dt"]; model = builder.finalize()
solver = newton.solvers.SolverMuJoCo(model, solver="cg", nconmax={contacts}, njmax={rows})""", {"units": "grain"}),
    "isaac": Program("usd", ".usdc", """\
omni.usd.get_context().open_stage("{file}")
omni.timeline.get_timeline_interface().play()
# as a part of another stage: write it with scene=false, in that stage's units""", {"units": "grain"}),
    "drake": Program("sdf", ".sdf", """\
plant, scene = AddMultibodyPlantSceneGraph(builder, {step:.3g})
Parser(plant).AddModels("{file}")
plant.Finalize()"""),
    "pybullet": Program("sdf", ".sdf", """\
pybullet.connect(pybullet.DIRECT); bodies = pybullet.loadSDF("{file}")
pybullet.setGravity(0, 0, -{gravity:.6g}); pybullet.setTimeStep({step:.3g})
pybullet.stepSimulation()""", {"units": "grain"}),
    "gazebo": Program("sdf", ".sdf", """\
cd {folder}
gz sim {name}"""),
    "openfoam": Program("openfoam", "", """\
cd {file}
./Allrun
grainsdem permeability ."""),
    "gmsh": Program("msh", ".msh", """\
gmsh {folder}/{stem}.geo -3"""),
    "paraview": Program("vtk", ".vtp", """\
paraview {file}"""),
    "blender": Program("glb", ".glb", """\
blender --python-expr 'import bpy; bpy.ops.import_scene.gltf(filepath="{file}")'"""),
    "printer": Program("3mf", ".3mf", """\
# {file} is in millimetres, an object a grain: open it in a slicer"""),
    "lammps": Program("lammps", ".in", """\
cd {folder}
lmp -in {name}"""),
    "yade": Program("yade", ".py", """\
cd {folder}
yade -x -n {name}"""),
    "rockable": Program("rockable", ".conf", """\
cd {folder}
rockable {name}"""),
    "3dec": Program("3dec", ".3ddat", """\
program call "{file}\""""),
}  # fmt: skip
"""Programs by name. Those that no test opens a file with are told in the table of formats."""


VOXELS = ("lbm", "palabos", "openlb", "porespy", "openpnm")
"""Programs that take voxels, which are no format of export."""


def program(name: str) -> Program:
    """Return a program by name.

    Raises
    ------
    InputError
        If there is no such program; the message lists those that are known.
    """
    if name.lower() in VOXELS:
        raise InputError(f"{name} reads voxels: grainsdem voxels BED out.nrrd, or .raw, --per-diameter 20")
    found = PROGRAMS.get(name.lower())
    if found is None:
        raise InputError(f"no program has the name {shown(name)}; known are {', '.join(PROGRAMS)}")
    return found


def path_for(path: Path, wanted: Program, name: str) -> Path:
    """Return the path of a file for a program: its suffix is put where there is none.

    Raises
    ------
    InputError
        If the suffix is that of another format.
    """
    allowed = FORMATS[wanted.format].suffixes
    if not wanted.suffix or path.suffix.lower() in allowed:
        return path
    if path.suffix:
        raise InputError(
            f"{path}: for {name} a bed is written as {wanted.format}, with the suffix {', '.join(allowed)} or none; "
            f"got {path.suffix!r}"
        )
    return path.with_suffix(wanted.suffix)


@gated
def opening(packing: Packing, path: str | Path, name: str, options: Mapping[str, Any] | None = None) -> list[str]:
    """Return the lines that open a file in the program that it was written for.

    Parameters
    ----------
    packing : Packing
        What was written.
    path : path-like
        The file.
    name : str
        The program.
    options : mapping, optional
        Options that it was written with besides the program's own.

    Raises
    ------
    InputError
        If there is no such program.
    """
    wanted, path = program(name), Path(path)
    found = find(wanted.format)
    module, made_with = found.module, shared([found], {**wanted.options, **(options or {})})[0]
    factors = {"length": 1.0, "time": 1.0}
    if hasattr(module, "factors"):
        factors |= module.factors(packing, made_with)
    gravity = float(getattr(made_with, "gravity", GRAVITY)) or GRAVITY
    diameter = float(np.median(cube_roots(volumes(packing.grains) * (6.0 / np.pi))))
    step = time_step(packing, None) * math.sqrt(diameter / gravity)
    contacts = max(100, _CONTACTS * len(packing))
    return wanted.lines.format(
        file=path.as_posix(),
        folder=path.parent.as_posix(),
        name=path.name,
        stem=path.stem,
        step=step / factors["time"],
        gravity=gravity * factors["time"] ** 2 / factors["length"],
        contacts=contacts,
        rows=3 * contacts,
    ).splitlines()
