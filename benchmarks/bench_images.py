"""A set of photographs, each of a bed of a thousand grains: ``python benchmarks/bench_images.py [photographs]``.

The recipe is that of ``examples/images.toml``, a bed for each photograph; the bar is four minutes for a hundred on two
cores. Processor time is that of all processes together: on a machine that is busy with other work, half of it is what
two idle cores would take, and more exact than the wall time.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.workers import n_processors

RECIPE = Path(__file__).parent.parent / "examples" / "images.toml"


def spent():
    """Return the processor time [s] of this process and of those that it started and that have ended."""
    return sum(
        use.ru_utime + use.ru_stime for use in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    recipe = gd.recipe.with_images(gd.recipe.read(RECIPE), per_bed=1)
    with tempfile.TemporaryDirectory() as folder:
        gd.images(recipe, Path(folder) / "warm", count=1, workers=1)  # compiles, where that is not done
        wall, processor, load = time.perf_counter(), spent(), os.getloadavg()[0]
        table = gd.images(recipe, Path(folder) / "set", count=count)
        wall, processor = time.perf_counter() - wall, spent() - processor
    assert (table["error"] == "").all()
    size = recipe.images.size
    print(
        f"{count} photographs of {size[0]} × {size[1]} pixels, {np.mean(table['n_grains']):.0f} grains a bed, "
        f"{n_processors()} processes: {wall:.0f} s, {processor:.0f} s of processor time; load before {load:.1f}; "
        f"for a hundred {100 / count * wall:.0f} s and {100 / count * processor:.0f} s"
    )


if __name__ == "__main__":
    main()
