"""Load a stage into Newton, step it with MuJoCo's solver, and say as JSON what bodies it made of it."""

import json
import sys
import warnings
from pathlib import Path

import newton
import numpy as np
import warp


def main(path, n_steps, time_step, result):
    warp.config.quiet = True
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
    found = {
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
    # Into a file: Newton itself prints to the screen.
    Path(result).write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), sys.argv[4])
