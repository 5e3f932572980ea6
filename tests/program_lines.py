"""Run lines that open a file in Newton or MuJoCo Warp, step it, and say as JSON how far grains went."""

import json
import sys
from pathlib import Path

import mujoco
import mujoco_warp
import newton
import numpy as np
import warp


def main(name, lines, n_steps, result):
    warp.config.quiet = True
    names = {"mujoco": mujoco, "mujoco_warp": mujoco_warp, "newton": newton}
    exec("\n".join(lines[:-1]), names)  # noqa: S102  (what a user would type)
    if name == "mjwarp":
        data = names["d"]
        start = data.xpos.numpy()[0, 2:].copy()
        for _ in range(n_steps):
            exec(lines[-1], names)  # noqa: S102
        end = data.xpos.numpy()[0, 2:]
        names["n_contacts"] = int(data.nacon.numpy()[0])
    else:
        # The graphics card that the last line is for may not be there.
        exec(lines[-1].replace(")", ", use_mujoco_cpu=True)"), names)  # noqa: S102
        model, before, after = names["model"], names["model"].state(), names["model"].state()
        start = before.body_q.numpy()[:, :3].copy()
        for _ in range(n_steps):
            before.clear_forces()
            names["solver"].step(before, after, model.control(), None, names["step"])
            before, after = after, before
        end = before.body_q.numpy()[:, :3]
    found = {"moved": np.linalg.norm(end - start, axis=1).tolist(), "contacts": names.get("n_contacts")}
    Path(result).write_text(json.dumps(found), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1], json.loads(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
