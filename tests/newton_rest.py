"""Load stages of beds at rest into Newton, step them with contacts, and say as JSON how far grains went."""

import json
import sys
import warnings
from pathlib import Path

import newton
import numpy as np
import warp


def solver_of(name, model):
    """Return a solver: what the stage says of MuJoCo's is taken over; XPBD has no other way to be told."""
    if name == "mujoco":
        return newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True, solver="cg")
    return newton.solvers.SolverXPBD(
        model, iterations=50, rigid_contact_con_weighting=False, rigid_contact_relaxation=0.5
    )


def rested(path, name, n_steps):
    """Return what became of a stage in so many of its own time steps."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        builder = newton.ModelBuilder()
        newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
        told = builder.add_usd(path)
        model = builder.finalize(device="cpu")
        solver = solver_of(name, model)
        contacts = model.contacts()
    # XPBD forgets friction from step to step: grains creep, the less the shorter its steps.
    step = told["physics_dt"] * (1.0 if name == "mujoco" else 0.5)
    before, after, control = model.state(), model.state(), model.control()
    start = before.body_q.numpy()[:, :3].copy()
    for _ in range(n_steps):
        before.clear_forces()
        if name != "mujoco":
            model.collide(before, contacts)
        solver.step(before, after, control, contacts, step)
        before, after = after, before
    end = before.body_q.numpy()[:, :3]
    friction, flags = model.shape_material_mu.numpy(), model.shape_flags.numpy()
    colliding = (flags & int(newton.ShapeFlags.COLLIDE_SHAPES)) > 0
    return {
        "step": told["physics_dt"],
        "gravity": np.abs(model.gravity.numpy()).max().item(),
        "masses": model.body_mass.numpy().tolist(),
        "frictions": np.unique(friction[colliding]).tolist(),
        "moved": np.linalg.norm(end - start, axis=1).tolist(),
        "lowest": (start[:, 2].min().item(), end[:, 2].min().item()),
    }


def main(tasks, result):
    warp.config.quiet = True
    found = [rested(*task) for task in tasks]
    # Into a file: Newton itself prints to the screen.
    Path(result).write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main(json.loads(sys.argv[1]), sys.argv[2])
