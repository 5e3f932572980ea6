"""Put a bed of gravel beside a robot of one's own in MuJoCo, in SI, and let its scoop lift some of it.

The bed is attached to the robot's model with a prefix, and the model gets the options that the bed's contacts are made
for. Prints what the scoop's motor bears beside the mass of the grains in it, and draws the scene. Run with ``--quick``
for few grains.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import mujoco  # noqa: TID253  (the robot is MuJoCo's)
import numpy as np

import exporters
import grainsdem as gd
from exporters import mjcf

SIZE = 8e-3
"""Median diameter [m]: of gravel in SI MuJoCo takes inertias as they are, down to some 0.5 mm."""

ROBOT = """
<mujoco model="robot">
  <compiler angle="degree"/>
  <asset><material name="floor" rgba="0.6 0.6 0.62 1"/><material name="steel" rgba="0.3 0.35 0.45 1"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1" material="floor"/>
    <geom name="stop" type="box" pos="0.105 0 0.03" size="0.01 0.06 0.03" material="floor"/>
    <geom name="near" type="box" pos="0.04 -0.05 0.03" size="0.055 0.01 0.03" rgba="0.6 0.6 0.62 0.2"/>
    <geom name="far" type="box" pos="0.04 0.05 0.03" size="0.055 0.01 0.03" material="floor"/>
    <body name="slide" pos="-0.09 0 0.012"><joint name="reach" type="slide" axis="1 0 0"/>
      <geom type="box" size="0.004 0.004 0.004" mass="2" material="steel" contype="0" conaffinity="0"/>
      <body name="lift"><joint name="raise" type="slide" axis="0 0 1"/>
        <geom type="box" size="0.004 0.004 0.004" mass="1" material="steel" contype="0" conaffinity="0"/>
        <body name="scoop"><joint name="wrist" type="hinge" axis="0 1 0"/>
          <geom name="bottom" type="box" pos="0.03 0 -0.008" size="0.03 0.03 0.002" material="steel" mass="0.2"/>
          <geom name="back" type="box" pos="0 0 0.008" size="0.002 0.03 0.018" material="steel" mass="0.1"/>
          <geom name="left" type="box" pos="0.03 0.03 0.008" size="0.03 0.002 0.018" material="steel" mass="0.1"/>
          <geom name="right" type="box" pos="0.03 -0.03 0.008" size="0.03 0.002 0.018" material="steel" mass="0.1"/>
        </body></body></body>
  </worldbody>
  <actuator>
    <position name="reach" joint="reach" kp="4000" dampratio="1"/>
    <position name="raise" joint="raise" kp="20000" dampratio="1"/>
    <position name="wrist" joint="wrist" kp="40" dampratio="1"/>
  </actuator>
  <sensor><actuatorfrc name="borne" actuator="raise"/></sensor>
</mujoco>
"""

PATH = np.array([
    (0.0, 0.0, 0.0, 0.0), (0.3, 0.0, 0.0, 0.0), (1.0, 0.115, 0.0, 0.0), (1.3, 0.115, 0.005, -30.0),
    (2.0, 0.06, 0.12, -30.0), (3.0, 0.06, 0.12, -30.0),
])  # fmt: skip
"""Times [s], and reach [m], height [m] and pitch [degrees] of the scoop, from where it begins."""

SCOOP = 1.5
"""Mass [kg] that the motor of height bears without grains."""


WIDTH = 0.078
"""Of the bed [m], between the robot's side walls."""


def make_bed(n: int) -> gd.Packing:
    """Return n grains of gravel, poured and at rest in a tray that is open towards the robot."""
    domain = gd.Domain.box((0.09, WIDTH, n * SIZE**3 / (0.09 * WIDTH)))
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=2)
    grains = gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.45)
    return gd.settle(grains, start="pour", friction=0.5, rng=1).packing


def scene_with(bed: gd.Packing) -> mujoco.MjModel:
    """Return the robot's model with the bed in it."""
    with tempfile.TemporaryDirectory() as folder:
        [path] = exporters.write(bed, Path(folder) / "bed.xml", units="si", walls="none")
        gravel = mujoco.MjSpec.from_file(str(path))
    robot = mujoco.MjSpec.from_string(ROBOT)
    robot.memory = gravel.memory
    for name, value in mjcf.options_for(bed, mjcf.MjcfOptions(units="si")).items():
        setattr(robot.option, name, value)
    robot.attach(gravel, prefix="gravel_", frame=robot.worldbody.add_frame(pos=[0.0, -WIDTH / 2, 0.0]))
    return robot.compile()


def follow(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Move the scoop along its path; return the mean force [N] of the motor of height over the last quarter second."""
    times, targets = PATH[:, 0], PATH[:, 1:] * (1, 1, np.pi / 180)
    forces = []
    while data.time < times[-1]:
        data.ctrl[:] = [np.interp(data.time, times, column) for column in targets.T]
        mujoco.mj_step(model, data)
        if data.time > times[-1] - 0.25:
            forces.append(data.sensor("borne").data[0])
    return float(np.mean(forces))


def as_grains(model: mujoco.MjModel, data: mujoco.MjData, bed: gd.Packing, boxes: list[str]) -> gd.Packing:
    """Return the grains where they are now and, as if they were grains, boxes of the robot."""
    corner = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    faces = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    names = [f"gravel_g{k:06d}" for k in range(len(bed))]
    shapes, n = bed.grains, len(boxes)
    sizes = [model.geom(name).size for name in boxes]
    turns = np.zeros((n, 4))
    for turn, name in zip(turns, boxes, strict=True):
        mujoco.mju_mat2Quat(turn, data.geom(name).xmat)
    return gd.Packing(
        gd.Polyhedra(
            np.vstack([shapes.vertices, *(size * corner for size in sizes)]),
            np.append(shapes.vertex_offsets, shapes.vertex_offsets[-1] + 8 * np.arange(1, n + 1)),
            np.append(shapes.face_offsets, shapes.face_offsets[-1] + 6 * np.arange(1, n + 1)),
            np.append(shapes.face_vertices, np.tile(faces.ravel(), n)),
            np.append(shapes.face_vertex_offsets, shapes.face_vertex_offsets[-1] + 4 * np.arange(1, 6 * n + 1)),
        ),
        np.array([*(data.body(name).xpos for name in names), *(data.geom(name).xpos for name in boxes)]),
        np.array([*(data.body(name).xquat for name in names), *turns]),
        np.append(bed.densities, np.full(n, 2700.0)),
        gd.Domain([-0.06, -0.06, 0.0], [0.12, 0.06, 0.2]),
    )


def main() -> None:
    """Print what the scoop bears and what is in it, and draw the scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few grains")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the picture")
    arguments = parser.parse_args()
    bed = make_bed(20 if arguments.quick else 200)
    model = scene_with(bed)
    data = mujoco.MjData(model)
    force = follow(model, data)
    grains = [b for b in range(model.nbody) if model.body(b).name.startswith("gravel_g")]
    lifted = [b for b in grains if data.xpos[b, 2] > 0.06]
    mass = float(model.body_mass[lifted].sum())
    borne = force / 9.81 - SCOOP
    print(f"{len(lifted)} of {len(grains)} grains, {1e3 * mass:.2f} g, hang in the scoop; it bears {1e3 * borne:.2f} g")
    boxes = ["bottom", "back", "left", "stop", "far"]  # the near ones are left out: one looks in
    scene = as_grains(model, data, bed, boxes)
    colours = np.append(gd.diameters(bed), np.full(len(boxes), gd.diameters(bed).min()))
    picture = gd.figures.render(scene, arguments.output / "arm.png", color_by=colours, size=(900, 640))
    print(f"drawn in {picture}")


if __name__ == "__main__":
    main()
