"""Load a stage into PhysX on the processor, step it, and say as JSON where its bodies went."""

import json
import sys
from pathlib import Path

import numpy as np
import ovphysx
import ovstage
from ovphysx import GlobalConfigKey, PhysX, set_global_config
from ovphysx.samples.python_samples.schema_support import physx_schema_paths
from ovphysx.types import SimObjectType


def places(physx):
    """Return the places of all bodies, in PhysX's own order."""
    with physx.read_sync(SimObjectType.RIGID_BODY, ["position"]) as found:
        return np.concatenate([tensor.numpy().copy() for group in found.groups for tensor in group.tensors])


def main(path, step, n_steps, result):
    set_global_config(GlobalConfigKey.CPU_ONLY, True)
    set_global_config(GlobalConfigKey.NUM_THREADS, 1)
    physx = PhysX()
    schemas = [*map(str, physx_schema_paths()), str(ovphysx.newton_schema_root())]
    ovstage.population.register_usd_schemas(schemas)
    stage = ovstage.Stage("bed")
    ovstage.population.open_usd(stage, path, ordinal=1, domains=ovstage.PopulationDomain.ALL)
    stage.advance_write_floor(ordinal=1).wait()
    physx.wait_task(physx.attach_ovstage(stage, read_ordinal=1))
    before = places(physx)
    for _ in range(n_steps):
        physx.step_sync(step)
    found = {"before": before.tolist(), "after": places(physx).tolist(), "version": ovphysx.__version__}
    Path(result).write_text(json.dumps(found), encoding="utf-8")
    physx.wait_task(physx.detach_ovstage())
    stage.destroy()
    physx.destroy()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
