"""Load a file in whatever MuJoCo is installed beside this Python, step it, and say as JSON what happened."""

import json
import sys

import mujoco
import numpy as np


def main(path, n_steps):
    messages = []
    mujoco.set_mju_user_warning(messages.append)
    load = mujoco.MjModel.from_binary_path if path.endswith(".mjb") else mujoco.MjModel.from_xml_path
    model = load(path)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_forward(model, data)
    grains = [b for b in range(model.nbody) if model.body(b).name.startswith("g0")]
    start = data.xpos[grains].copy()
    first = {"contacts": data.ncon, "deepest": float(data.contact.dist.min(initial=0.0))}
    for _ in range(n_steps):
        mujoco.mj_step(model, data)
    found = {
        "version": mujoco.__version__,
        "grains": len(grains),
        "mass": float(model.body_mass[grains].sum()),
        "start": first,
        "warnings": [*messages, *(str(warning) for warning in data.warning.number if warning)],
        "time": data.time,
        "fallen": float(start[:, 2].mean() - data.xpos[grains, 2].mean()),
        "lowest": float(data.xpos[grains, 2].min()),
        "deepest": float(data.contact.dist.min(initial=0.0)),
        "finite": bool(np.isfinite(data.qpos).all()),
    }
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
