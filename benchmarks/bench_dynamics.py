"""Dynamics against its bars: ``python benchmarks/bench_dynamics.py [loop settle defaults large yade]`` prints a table.

Times are of the processor, of one thread, so that a busy machine counts less; ratios are of runs in the same minutes.
Yade's polyhedra run where Debian's package ``yade`` is installed.
"""

from __future__ import annotations

import json
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import textwrap
import time
from pathlib import Path

import mujoco  # noqa: TID253  (it is the peer)
import numpy as np

import exporters
from exporters import mjcf
from grainsdem.dynamics import settle
from grainsdem.dynamics.loop import Record
from grainsdem.dynamics.mechanics import sample
from grainsdem.dynamics.scene import scene_of
from grainsdem.dynamics.settle import SettleLoop
from grainsdem.measures import core_box, porosity
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

DEFAULTS_FROM = 300
"""Steps after which the two sets of options are compared: the grains have met by then."""

LEAST_TIME = 2.0
"""Time [t] before which grains that were just let go are slow, too."""

POROSITY = 0.45
"""Of the beds as grown."""

YADE_ENERGY = 1e-4
"""Mean kinetic energy of a grain [m g d] that both engines are taken to."""

YADE_BUDGET = 90.0
"""Processor time [s] that Yade is given; what is missing is extrapolated, and said."""


def bed(n, base):
    """Return ``n`` grains of a relaxed tessellation in a box as wide and deep as ``base`` median diameters of 1 m."""
    domain = Domain.box((base, base, np.pi / 6 / (1 - POROSITY) * n / base**2))
    seeds = relax(poisson(domain, n, rng=1), domain, iterations=2)
    return shrink(carve(tessellate(seeds, domain), keep="all"), porosity=POROSITY)


def row(work, figure, bar="", note=""):
    print(f"{work:<64} {figure:>12}   {'bar ' + bar if bar else '':<12} {note}", flush=True)


def clock():
    return time.process_time()


def bench_loop():
    """Our loop, history and checks on, against bare steps from the same state, alternating."""
    packing = bed(500, 8)
    options = mjcf.MjcfOptions()
    scene = scene_of(packing, mjcf.text(packing, options), options.gravity)
    scene.engine.step(300)
    with tempfile.TemporaryDirectory() as folder:
        run = SettleLoop(scene, Record(Path(folder) / "history.h5"), None, scene.time() + 3.0)
        start_state = scene.state()
        ratios = []
        for trial in range(3):
            scene.restore(start_state)
            start = clock()
            for _ in range(300):
                mujoco.mj_step(scene.engine.model, scene.engine.data)
            bare = clock() - start
            scene.restore(start_state)
            run = SettleLoop(scene, Record(Path(folder) / f"{trial}.h5"), None, scene.time() + 3.0 - 1e-9)
            start = clock()
            run.run()
            ours = (clock() - start) / run.n_steps * 300
            ratios.append(bare / ours)
    row(
        "our loop with history, checks and checkpoints: speed over bare steps",
        f"{np.median(ratios):.3f}",
        ">= 0.93",
        f"500 grains, {', '.join(f'{r:.3f}' for r in ratios)}",
    )


def bench_settle(n=1000, base=10):
    """Settle a thousand grains."""
    packing = bed(n, base)
    figures = {}
    for start in ("place", "pour"):
        wall, cpu = time.perf_counter(), clock()
        result = settle(packing, start=start, rng=1, friction=0.5)
        cpu, wall = clock() - cpu, time.perf_counter() - wall
        core = porosity(result.packing, region=core_box(result.packing))
        note = (
            f"wall {wall:.0f} s, at rest {result.report.at_rest}, {result.report.n_steps} steps, overlap mean/max "
            f"{result.report.overlap_mean:.1e}/{result.report.overlap_max:.1e} d, porosity {core:.3f}, "
            f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"
        )
        row(f"settle {n} grains, {start}: processor time [s]", f"{cpu:.0f}", "<= 180" if n == 1000 else "", note)
        figures[start] = cpu, result
    return packing, figures


def bench_defaults():
    """Compare with MuJoCo's default options: what it costs to simulate as long, from our bed on."""
    packing = bed(1000, 10)
    options = mjcf.MjcfOptions()
    text = mjcf.text(packing, options)
    ours = scene_of(packing, text, options.gravity).engine
    default = mujoco.MjModel.from_xml_string(plain(text))
    data = mujoco.MjData(default)
    ours.step(DEFAULTS_FROM)
    state, step = ours.state(), ours.time_step
    our_each = stepping(lambda: ours.step(1), 40)
    ours.restore(state)
    data.qpos[:], data.qvel[:] = ours.data.qpos, ours.data.qvel
    each = stepping(lambda: mujoco.mj_step(default, data), 10)
    ratio = each / default.opt.timestep / (our_each / step)
    note = (
        f"{1e3 * each:.0f} ms a step of {default.opt.timestep} t, {1e3 * our_each:.0f} ms a step of {step} t, 1000 "
        f"grains from {DEFAULTS_FROM * step:g} t on; extrapolated from 10 steps to as long a simulation"
    )
    row("MuJoCo's default options over ours, time to simulate as long", f"{ratio:.0f}", ">= 20", note)


def stepping(step, n):
    """Return the processor time of a step, the mean of a few."""
    step()
    start = clock()
    for _ in range(n):
        step()
    return (clock() - start) / n


def plain(text):
    """Return a model's text with MuJoCo's own options and contacts; gravity stays."""
    text, options = re.subn(r"<option [^>]*>.*?</option>", '<option gravity="0 0 -1"/>', text, flags=re.DOTALL)
    text, contacts = re.subn(r'<geom solref="[^"]*" solimp="[^"]*"/>', "", text)
    assert (options, contacts) == (1, 1)
    return text


def bench_large(n=5000, base=17):
    """One step in a bed of five thousand grains, by solver, thread pool and step."""
    packing = bed(n, base)
    options = mjcf.MjcfOptions()
    cpu = clock()
    scene = scene_of(packing, mjcf.text(packing, options), options.gravity)
    engine, cpu = scene.engine, clock() - cpu
    row(f"{n} grains: text and model, processor time [s]", f"{cpu:.0f}", "", "taken from the cache the next time")
    engine.step(100)
    state, solvers = engine.state(), mujoco.mjtSolver
    for name, threads, step in (("PGS", 0, 0.01), ("CG", 0, 0.01), ("CG", 2, 0.01), ("PGS", 0, 0.02)):
        engine.restore(state)
        engine.set_time_step(step)
        engine.model.opt.solver = getattr(solvers, f"mjSOL_{name}")
        engine.model.opt.iterations = {"PGS": 30, "CG": 100}[name]
        if threads and hasattr(mujoco, "mju_threadpool"):
            mujoco.mju_threadpool(engine.data, threads)
        engine.step(5)
        wall, cpu = time.perf_counter(), clock()
        engine.step(20)
        cpu, wall = (clock() - cpu) / 20, (time.perf_counter() - wall) / 20
        now = sample(scene)
        row(
            f"{n} grains, {name}, {threads or 1} threads, step {step} t: a step [ms]",
            f"{1e3 * cpu:.0f}",
            "",
            f"wall {1e3 * wall:.0f} ms, {cpu / step:.1f} s a t, {now.n_contacts} contacts, overlap "
            f"{now.overlap_mean:.1e}/{now.overlap_max:.1e} d, {engine.data.maxuse_arena / 2**20:.0f} MB of arena, "
            f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB in all",
        )


DRIVER = """
import time, json
grains = [b for b in O.bodies if b.id < {n}]
mass = sum(b.state.mass for b in grains) / len(grains)
started, told = time.process_time(), 0.0
energy, history, deepest = 1e9, [], 0.0
while time.process_time() - started < {budget}:
    O.run(200, True)
    energy = sum(0.5 * b.state.mass * b.state.vel.squaredNorm() for b in grains) / len(grains) / mass
    history.append((O.time, time.process_time() - started, energy))
    if energy < {goal} and O.time > {least}:
        break
depths = [i.geom.equivalentPenetrationDepth for i in O.interactions if i.isReal]
print("RESULT", json.dumps(dict(history=history, dt=O.dt, steps=O.iter, overlaps=depths, energy=energy)), flush=True)
import os; os._exit(0)
"""


def bench_yade():
    """Two hundred grains, in the same box, from the same start, one thread each."""
    start = bed(200, 6)
    options = mjcf.MjcfOptions()
    scene = scene_of(start, mjcf.text(start, options), options.gravity)
    cpu = clock()
    while scene.time() < LEAST_TIME or sample(scene).kinetic_energy > YADE_ENERGY:
        scene.engine.step(20)
    ours, our_time = clock() - cpu, scene.time()
    depths = sample(scene)
    row(
        "settle 200 grains in place to 1e-4 m g d: processor time [s]",
        f"{ours:.1f}",
        "",
        f"{our_time:.1f} t, overlap {depths.overlap_mean:.1e}/{depths.overlap_max:.1e} d",
    )
    if shutil.which("yade") is None:
        row("Yade", "–", ">= 150", "yade is not installed: apt-get install yade")
        return
    with tempfile.TemporaryDirectory() as folder:
        found = run_yade(start, Path(folder))
    history = np.array(found["history"])
    reached = found["energy"] < YADE_ENERGY
    per_time = history[-1, 1] / history[-1, 0]
    whole = history[-1, 1] if reached else per_time * our_time
    if reached:
        how = f"to the same energy in {history[-1, 0]:.1f} t"
    else:
        how = (
            f"extrapolated to our {our_time:.1f} t from {history[-1, 0]:.2f} t: {found['steps']} steps of "
            f"{found['dt']:.1e} t in {history[-1, 1]:.0f} s; its energy was {found['energy']:.1e} there"
        )
    row("Yade's polyhedra over ours, processor time", f"{whole / ours:.0f}", ">= 150", how)
    depth = np.array(found["overlaps"])
    row("Yade's overlap there, mean [d]", f"{depth.mean():.1e}", "", f"max {depth.max():.1e} d, {depth.size} contacts")


def run_yade(start, folder):
    exporters.write(start, folder / "bed.py")
    script = next(folder.glob("*.py"))
    driver = DRIVER.format(n=len(start), budget=YADE_BUDGET, goal=YADE_ENERGY, least=LEAST_TIME)
    script.write_text(script.read_text() + textwrap.dedent(driver))
    command = [shutil.which("yade"), "-n", "-x", "-j1", script.name]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603  (our script)
    line = next((x for x in done.stdout.splitlines() if x.startswith("RESULT")), None)
    if line is None:
        raise SystemExit(done.stdout[-2000:] + done.stderr[-2000:])
    return json.loads(line.removeprefix("RESULT"))


PARTS = {
    "loop": bench_loop,
    "settle": bench_settle,
    "defaults": bench_defaults,
    "large": bench_large,
    "yade": bench_yade,
}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
