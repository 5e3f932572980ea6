"""Load stages into Newton, step them with MuJoCo's solver, and say as JSON what bodies it made of them."""

import json
import sys
import warnings
from pathlib import Path

import newton
import numpy as np
import warp


def moved(path, n_steps, time_step):
    """Return what a stage was taken for, and how far its bodies fell."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        builder = newton.ModelBuilder()
        builder.add_usd(path)
        model = builder.finalize(device="cpu")
        solver = newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True, solver="cg", iterations=50)
    before, after, control = model.state(), model.state(), model.control()
    start = before.body_q.numpy()[:, :3].copy()
    for _ in range(n_steps):
        before.clear_forces()
        solver.step(before, after, control, None, time_step)
        before, after = after, before
    end = before.body_q.numpy()[:, :3]
    return {
        "version": newton.__version__,
        "names": list(model.body_label if hasattr(model, "body_label") else model.body_key),
        "masses": model.body_mass.numpy().tolist(),
        "inertias": model.body_inertia.numpy().tolist(),
        "centres": model.body_com.numpy().tolist(),
        "positions": start.tolist(),
        "fallen": (start - end)[:, 2].tolist(),
        "finite": bool(np.isfinite(end).all()),
        "warnings": [str(each.message) for each in caught],
    }


def main(tasks, result):
    warp.config.quiet = True
    found = [moved(*task) for task in tasks]
    # Into a file: Newton itself prints to the screen.
    Path(result).write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main(json.loads(sys.argv[1]), sys.argv[2])
