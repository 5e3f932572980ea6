"""Damaged files for every reader: valid ones of each format, changed at random, read until something goes wrong.

``python tests/fuzzing_files.py --minutes N [--seed S] [formats]`` prints what went wrong and how many files were read a
second; what makes a reader fail is saved. A reader may give a result, or an error of ours in one line. Each format runs
in a process of its own: the file at which one ends is known, and the rest goes on after it.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import io
import json
import os
import random
import re
import select
import shutil
import signal
import struct
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from fuzzing import PATIENCE, outcome, sort_of, tell

import exporters
import grainsdem as gd
from exporters.meshes.stl import RECORD, TABLE
from exporters.openfoam.flow import flow
from exporters.reading.stages import arrays as read_stage
from exporters.void.tetrahedra import quality
from grainsdem import apart, storage
from grainsdem.dynamics.checkpoint import load_checkpoint
from grainsdem.dynamics.experiments.parts.joined.driving import table_driver
from grainsdem.dynamics.experiments.parts.joined.fragment import read_fragment
from grainsdem.dynamics.experiments.parts.meshes import read_hulls
from grainsdem.model import Packing, Polyhedra, Surroundings
from grainsdem.recipe.grains.sizes import _read as read_sizes
from grainsdem.storage.seals import seal

NUMBERS = (
    "nan", "inf", "-inf", "0", "-1", "-0.0", "1e308", "-1e308", "1e-308", "1e400", "9223372036854775808", "4294967296",
    "2147483648", "-2147483649", "0x10", "1_0", "1,5", "1.5.2", "", "--1", "1e", "٣", "9" * 4301, "true", "null",
)  # fmt: skip
"""What stands for a number in a text."""

WORDS = (*NUMBERS, "abc", "/", "../../etc/passwd", "\0", "\x1b[2J", "[/bold]", "[[", "}", '"', "<", "&lt;", "%", "é")
"""What stands for a word."""

MOST = 1_000_000
"""Bytes of a file that is not made longer."""

PATTERNS = (
    b"\0" * 4,
    b"\xff" * 4,
    b"\xff" * 8,
    struct.pack("<f", np.nan),
    struct.pack("<d", 1e308),
    b"\x7f\xff\xff\xff",
)
"""What is written over bytes."""

DOORS = {"damaged HDF5": "h5|history", "damaged STL, OBJ, USD, MJCF": "mjcf|usd|stl|obj|scan-stl|scan-obj|hulls"}
"""Rows of the table, and how the names of their formats begin."""

NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")


class Format(NamedTuple):
    """A kind of file: what valid ones hold, what reads them, and whether the reader's caller shields from crashes."""

    suffix: str
    seeds: list[bytes]
    read: str
    is_text: bool = False
    is_apart: bool = False
    change: object = None


def judged(read):
    """Return a reader of packings after which the packing is validated, as whoever reads a file does."""

    def whole(path):
        packing = read(path)
        gd.validate(packing)
        return packing

    return whole


def read_case(path):
    """Read the flow of a case whose notes are a file."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        rates = place / "postProcessing" / "flowRate" / "0" / "surfaceFieldValue.dat"
        rates.parent.mkdir(parents=True)
        rates.write_text("# time sum\n1 1e-9\n2 1.1e-9\n")
        shutil.copy(path, place / "case.json")
        return flow(place)


def read_beside(path):
    """Read a tetrahedron in STL with a file as the table of its triangles."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
    records = np.zeros(4, dtype=RECORD)
    records["corners"] = points[[(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "bed.stl"
        place.write_bytes(bytes(80) + struct.pack("<I", 4) + records.tobytes())
        shutil.copy(path, place.with_name(f"bed{TABLE}"))
        return exporters.read(place)


EMPTY = Packing(
    Polyhedra(np.empty((0, 3)), [0], [0], [], [0]), np.empty((0, 3)), np.empty((0, 4)), [], gd.Domain.cube()
)
"""No grains."""

READ = {
    "packing": judged(gd.load),
    "history": lambda path: (
        storage.load_history(path),
        storage.load_surroundings(path),
        storage.load_moved(path, EMPTY),
    ),
    "export": judged(exporters.read),
    "stage": read_stage,
    "triangles": read_beside,
    "scan": gd.shapes.read,
    "hulls": read_hulls,
    "points": gd.points.read,
    "density": gd.points.read_density,
    "image": gd.points.image_density,
    "sizes": read_sizes,
    "sieves": gd.read_sieves,
    "recipe": gd.recipe.read,
    "survey": lambda path: next(gd.survey.read(path).jobs()),
    "survey table": gd.survey.load,
    "checkpoint": lambda path: load_checkpoint(path, {}),
    "drive": lambda path: table_driver(str(path), "speed"),
    "part": lambda path: read_fragment(str(path)),
    "case": read_case,
    "tetrahedra": quality,
}
"""Every reader by a name for what it reads; the stage is that of USD without the process that shields from it."""


def written(folder, name, make):
    """Return the bytes of the file that a function makes."""
    path = Path(folder) / name
    make(path)
    return path.read_bytes()


def change_h5(rng, content, path):
    """Change a dataset or an attribute of a sealed file, and seal it again: HDF5 itself finds it sound."""
    path.write_bytes(content)
    with h5py.File(path, "r+") as file:
        names = []
        file.visit(names.append)
        one = file[rng.choice(names)] if rng.random() < 0.8 else file
        if isinstance(one, h5py.Dataset):
            change_dataset(rng, file, one)
        elif one.attrs and rng.random() < 0.8:
            change_attribute(rng, one)
        elif one.name != "/":
            del file[one.name]
    seal(path)
    return path.read_bytes()


def change_dataset(rng, file, one):
    """Change what one dataset holds."""
    name, values = one.name, one[()]
    kind = rng.randrange(7)
    if kind == 0 and values.size and values.dtype.names is None:
        flat = values.reshape(-1).copy()
        with np.errstate(all="ignore"):
            worse = rng.choice([0, -1, 1, np.nan, np.inf, 1e308, -1e308, 2**31 - 1, -(2**31), 127, 2**62, 1e-308])
            flat[rng.randrange(flat.size)] = np.array(worse, dtype=np.float64).astype(flat.dtype)
        one[...] = flat.reshape(values.shape)
        return
    del file[name]
    if kind == 1:
        file.create_dataset(name, (10 ** rng.randrange(3, 12), *values.shape[1:]), values.dtype, chunks=True)
    elif kind == 2 and values.dtype.names is None:
        with np.errstate(all="ignore"):
            values = values.astype(rng.choice(["f4", "i8", "u8", "i1", "c16", "f2", "S3", "?", ">f8"]))
        file[name] = values
    elif kind == 3:
        file[name] = values.reshape(-1) if values.ndim > 1 else values[..., None]
    elif kind == 4:
        file[name] = values[: rng.randrange(len(values) + 1)] if values.ndim else values
    elif kind == 5:
        file[name] = rng.choice(["text", b"bytes", 1.0, np.float64(np.nan), 2**62])
    else:
        file[name] = rng.choice([h5py.SoftLink("/positions"), h5py.SoftLink(name), h5py.ExternalLink("x.h5", "/")])


def change_attribute(rng, one):
    """Change one attribute of an object."""
    name = rng.choice(list(one.attrs))
    texts = (
        "",
        "[1, 2]",
        '["x"]',
        '["{"]',
        '["{}"]',
        "[null]",
        '["{\\"step\\":\\"[/bold]\\"}"]',
        "[" * 9999,
        "{}",
        "é\n",
    )
    value = rng.choice([*texts, 1, 2**62, np.nan, np.arange(3), b"\xff\xfe", "2.0", None, np.zeros((0, 2)), ["a", "b"]])
    del one.attrs[name]
    if value is not None:
        one.attrs[name] = value


def images(folder, suffix):
    """Return small images as Pillow writes them."""
    from PIL import Image

    greys = np.arange(64, dtype=np.uint8).reshape(8, 8) * 4
    colours = np.dstack([greys, greys.T, greys])
    kinds = [Image.fromarray(greys), Image.fromarray(colours)]
    if suffix == ".png":
        kinds += [Image.fromarray(greys.astype(np.uint16) * 257), Image.fromarray(colours).convert("P")]
    if suffix == ".tif":
        kinds += [Image.fromarray(greys.astype(np.float32)), Image.fromarray(greys.astype(np.int32))]
    return [written(folder, f"image{suffix}", one.save) for one in kinds]


CASE = {
    "axis": "z", "lower": [0, 0, 0], "upper": [1e-3, 1e-3, 1e-3], "volume": 1e-9, "viscosity": 1e-6,
    "kinematic_pressure_drop": 1e-3, "mean_diameter": 1e-4, "porosity": 0.4,
}  # fmt: skip

RECIPE = b"""name = "bed"
[domain]
side = 3e-3
[seeds]
process = "poisson"
relax = 2
[grains]
porosity = 0.4
keep = "all"
sizes = {law = "lognorm", parameters = {s = 0.3, scale = 1e-3}, tolerance = 0.05}
throats = {fraction = 0.3}
"""

TRIANGLES = b"grain,first_triangle,n_triangles,class\n0,0,4,2\n"

MSH = b"""$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
5
1 0 0 0
2 1e-3 0 0
3 0 1e-3 0
4 0 0 1e-3
7 -1e-3 0 0
$EndNodes
$Elements
3
1 15 2 0 1 1
2 4 2 5 1 1 2 3 4
3 4 2 5 1 1 3 7 4
$EndElements
"""

SURVEY = b'[survey]\nrepeats = 2\nvary = {"grains.porosity" = [0.4, 0.5]}\n'

SHEET = b"sieve (mm),passing (%)\n4,100\n2,80\n1,30\n0.5,5\n"

PART = b"""<mujoco><worldbody><body name="arm" pos="0 0 0.01"><joint name="turn" type="hinge" axis="0 0 1"/>
<geom name="blade" type="box" size="0.01 0.002 0.003" density="7800"/></body></worldbody></mujoco>
"""


def formats(folder):
    """Return every format by its name, with valid files that are made in a folder."""
    domain = gd.Domain.cube(3e-3)
    points = gd.points.poisson(domain, 12, rng=1)
    packing = gd.shrink(gd.carve(gd.tessellate(points, domain), keep="all"), porosity=0.4)

    def history(path, around=None, grains=None):
        columns = {"time": "s", "energy": "J"}
        with storage.HistoryWriter(path, columns, n_grains=2, around=around, grains=grains) as one:
            moves = None if around is None else (around.positions[0], around.quaternions[0], around.gravity[0])
            for k in range(20):
                one.append(time=k, energy=k**2)
                one.append_frame(k, positions=np.ones((2, 3)), quaternions=np.ones((2, 4)), around=moves)

    def recorded(path):
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        poses = np.zeros((1, 1, 3)), np.ones((1, 1, 4)), np.zeros((1, 3))
        history(path, Surroundings(("lid",), corners, np.array([[0, 1, 2]]), np.zeros(3), *poses), packing)

    def export(suffix, **options):
        return written(folder, f"bed{suffix}", lambda path: exporters.write(packing, path, overwrite=True, **options))

    def saved(name, save, values):
        return written(folder, name, lambda path: save(path, values))

    bed = written(folder, "bed.h5", lambda path: gd.save(packing, path))
    run, more = written(folder, "run.h5", history), written(folder, "more.h5", recorded)
    seal_length = len(bed) - bed.rindex(b"\ngrainsdem sha256")
    ascii_stl = ascii_of(packing)
    table = written(folder, "seeds.csv", lambda path: gd.points.write(points, path))
    stl, obj = export(".stl"), export(".obj")
    spoken = io.BytesIO()
    np.savez(
        spoken,
        state=np.ones(3),
        samples=np.ones(2),
        words=np.array('{"version": 3, "memory": {}, "identity": {}, "n_frames": 0}'),
    )
    return {
        "h5-bytes": Format(".h5", [bed], "packing"),
        "h5-content": Format(".h5", [bed], "packing", change=change_h5),
        "h5-unsealed": Format(".h5", [bed[:-seal_length]], "packing"),
        "history-content": Format(".h5", [run, more], "history", change=change_h5),
        "history-unsealed": Format(".h5", [run[:-seal_length]], "history"),
        "mjcf": Format(".xml", [export(".xml")], "export", is_text=True),
        "usda": Format(".usda", [export(".usda")], "export", is_text=True),
        "usdc": Format(".usdc", [export(".usdc")], "export"),
        "usdz": Format(".usdz", [export(".usdz")], "export"),
        "usda-inside": Format(".usda", [export(".usda")], "stage", is_text=True, is_apart=True),
        "usdc-inside": Format(".usdc", [export(".usdc")], "stage", is_apart=True),
        "stl": Format(".stl", [stl], "export"),
        "stl-text": Format(".stl", [ascii_stl], "export", is_text=True),
        "stl-table": Format(".csv", [TRIANGLES], "triangles", is_text=True),
        "obj": Format(".obj", [obj], "export", is_text=True),
        "scan-stl": Format(".stl", [stl, ascii_stl], "scan"),
        "scan-obj": Format(".obj", [obj], "scan", is_text=True),
        "scan-ply": Format(".ply", plys(), "scan"),
        "scan-ply-text": Format(".ply", plys(text=True), "scan", is_text=True),
        "hulls-stl": Format(".stl", [stl, ascii_stl], "hulls"),
        "hulls-obj": Format(".obj", [obj], "hulls", is_text=True),
        "points-csv": Format(".csv", [table, b"id;x;y;z\n1;0,1;0,2;0,3\n2;0,4;0,5;0,6\n"], "points", is_text=True),
        "points-xyz": Format(".xyz", [b"2\natoms\nH 0 0 1\nH 1 0 0.5\n"], "points", is_text=True),
        "points-npy": Format(".npy", [saved("a.npy", np.save, points)], "points"),
        "points-npz": Format(".npz", [saved("a.npz", np.savez_compressed, points)], "points"),
        "density-npy": Format(".npy", [saved("d.npy", np.save, np.ones((4, 4, 4)))], "density"),
        "sizes": Format(".txt", [b"1e-3\n2e-3\n1.5e-3\n"], "sizes", is_text=True),
        "sizes-npy": Format(".npy", [saved("s.npy", np.save, np.ones(9))], "sizes"),
        "sieves": Format(".csv", [SHEET, b"size;retained\nNo. 40;12.5\nNo. 60;30\npan;3\n"], "sieves", is_text=True),
        "png": Format(".png", images(folder, ".png"), "image"),
        "jpg": Format(".jpg", images(folder, ".jpg"), "image"),
        "tif": Format(".tif", images(folder, ".tif"), "image"),
        "recipe": Format(".toml", [RECIPE], "recipe", is_text=True),
        "survey": Format(".toml", [RECIPE + SURVEY], "survey", is_text=True),
        "survey-table": Format(".csv", [b"case,porosity,name\n0,0.4,a\n1,0.5,b\n"], "survey table", is_text=True),
        "checkpoint": Format(".npz", [spoken.getvalue()], "checkpoint"),
        "drive": Format(".csv", [b"time,turn:speed\n0,0\n1,2.5\n"], "drive", is_text=True),
        "tetrahedra": Format(".msh", [MSH], "tetrahedra", is_text=True),
        "part": Format(".xml", [PART], "part", is_text=True),
        "case": Format(".json", [json.dumps(CASE).encode()], "case", is_text=True),
    }


def ascii_of(packing):
    """Return a packing as an ASCII STL file."""
    lines = []
    corners, faces = packing.grains.vertices_of(0) + packing.positions[0], packing.grains.faces_of(0)
    for face in faces:
        for b, c in pairwise(face[1:]):
            points = "".join(f"      vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in corners[[face[0], b, c]])
            lines.append(f"  facet normal 0 0 0\n    outer loop\n{points}    endloop\n  endfacet\n")
    return f"solid g0 unit 0.001 m\n{''.join(lines)}endsolid g0\n".encode()


def plys(*, text=False):
    """Return a tetrahedron as PLY."""
    head = (
        "ply\nformat {}\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4") * np.float32(1e-3)
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    if text:
        body = "".join(f"{x} {y} {z}\n" for x, y, z in points) + "".join(f"3 {a} {b} {c}\n" for a, b, c in faces)
        return [(head.format("ascii 1.0") + body).encode()]
    return [head.format("binary_little_endian 1.0").encode() + points.tobytes() + b"".join(
        struct.pack("<B3i", 3, *face) for face in faces
    )]  # fmt: skip


def changed(kind, rng, path):
    """Write a changed file of a format to a path."""
    content = rng.choice(kind.seeds)
    if kind.change is not None:
        kind.change(rng, content, path)
        return
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        if len(content) > MOST:
            break
        content = (change_text if kind.is_text and rng.random() < 0.8 else change_bytes)(rng, content)
    path.write_bytes(content)


def change_bytes(rng, content):
    """Return bytes of which some are turned, written over, cut out, doubled or cut off."""
    data = bytearray(content)
    # The head decides most; half of all changes are there.
    place = rng.randrange(min(len(data), 256) if rng.random() < 0.5 else len(data)) if data else 0
    length = rng.choice((1, 2, 4, 8, 64, 1000))
    kind = rng.randrange(6)
    if kind == 0 and data:
        data[place] ^= 1 << rng.randrange(8)
    elif kind == 1:
        data[place : place + 4] = rng.choice(PATTERNS)
    elif kind == 2:
        del data[place : place + length]
    elif kind == 3:
        data[place:place] = data[place : place + length]
    elif kind == 4:
        del data[place:]
    else:
        data[place : place + length] = rng.randbytes(length)
    return bytes(data)


def change_text(rng, content):
    """Return a text of which a number, a word or a line is another."""
    text = content.decode("utf-8", "surrogateescape")
    kind = rng.randrange(6)
    if kind <= 1:
        found = list(NUMBER.finditer(text))
        if found:
            one = rng.choice(found)
            text = text[: one.start()] + rng.choice(NUMBERS) + text[one.end() :]
    elif kind == 2:
        words = list(re.finditer(r"[^\s,;=\"<>]+", text))
        if words:
            one = rng.choice(words)
            text = text[: one.start()] + rng.choice(WORDS) * rng.choice((1, 1, 1, 2000)) + text[one.end() :]
    else:
        lines = text.split("\n")
        place = rng.randrange(len(lines))
        if kind == 3:
            del lines[place]
        elif kind == 4:
            lines[place:place] = [lines[place]] * rng.choice((1, 2, 1000))
        else:
            lines[place] = lines[place][: rng.randrange(len(lines[place]) + 1)]
        text = "\n".join(lines)
    return text.encode("utf-8", "surrogateescape")


def rng_of(name, seed, number):
    """Return the source of one file's changes."""
    return random.Random(f"{name} {seed} {number}")  # noqa: S311  (nothing is kept secret)


def serve(name, kind, seed, first, last, deadline, folder, answers):
    """Read files of one format, and tell of each before and after."""
    noise = os.open(folder / "noise", os.O_CREAT | os.O_RDWR | os.O_TRUNC)
    os.dup2(noise, 1)
    os.dup2(noise, 2)
    number = first
    while number < last and time.monotonic() < deadline:
        path = folder / f"{name}{kind.suffix}"
        changed(kind, rng_of(name, seed, number), path)
        os.write(answers, f"{number}\n".encode())
        begun = time.monotonic()
        wrong = outcome(lambda: READ[kind.read](path), {})  # noqa: B023  (called at once)
        seconds = time.monotonic() - begun
        if seconds > PATIENCE:  # a reader may have taken the alarm for what a file is to blame for
            wrong = f"took {seconds:.0f} s"
        size = os.fstat(noise).st_size
        if size:
            said = os.pread(noise, 80, 0)
            os.ftruncate(noise, 0)
            os.lseek(noise, 0, os.SEEK_SET)
            wrong = wrong or (None if kind.is_apart else f"printed {size} bytes: {said!r}")
        if wrong:
            os.write(answers, f"{number} {json.dumps(wrong)}\n".encode())
        number += 1
    os.write(answers, b"end\n")


def fuzz(name, kind, *, seed, minutes, most, folder):
    """Yield the number and the fault of each changed file at which a reader does wrong; return how many were read, and
    at how many a process ended that is there to end.
    """
    deadline, number, ends = time.monotonic() + 60 * minutes, 0, 0
    while number < most and time.monotonic() < deadline:
        source, sink = os.pipe()
        child = os.fork()
        if not child:
            with contextlib.suppress(BaseException):
                os.close(source)
                serve(name, kind, seed, number, most, deadline, folder, sink)
            os._exit(0)
        os.close(sink)
        last, ended, faults = number, False, []
        buffered = b""
        while True:
            if not select.select([source], [], [], PATIENCE + 20)[0]:
                os.kill(child, signal.SIGKILL)
                break
            block = os.read(source, 65536)
            if not block:
                break
            *lines, buffered = (buffered + block).split(b"\n")
            for line in lines:
                word, _, fault = line.decode().partition(" ")
                if word == "end":
                    ended = True
                    continue
                last = int(word)
                if fault:
                    faults.append((last, json.loads(fault)))
            yield from faults
            faults.clear()
        os.close(source)
        status = os.waitpid(child, 0)[1]
        number = last + 1
        if ended:
            break
        if kind.is_apart:
            ends += 1
        else:
            yield last, f"ended the process: {os.WTERMSIG(status) or os.WEXITSTATUS(status)}"
    return number, ends


def counted(name, kind, folder, kept, *, seed, minutes, most=10**9):
    """Print and save what goes wrong with a format, once for each kind of fault; return their counts."""
    known, begun, row = set(), time.monotonic(), collections.Counter()
    found = fuzz(name, kind, seed=seed, minutes=minutes, most=most, folder=folder)
    while True:
        try:
            number, fault = next(found)
        except StopIteration as end:
            n, ends = end.value
            break
        row[sort_of(fault)] += 1
        sort = re.sub(r"[\d'\"].*", "", fault)[:60]
        if sort in known:
            continue
        known.add(sort)
        kept.mkdir(parents=True, exist_ok=True)
        path = kept / f"{name}-{seed}-{number}{kind.suffix}"
        changed(kind, rng_of(name, seed, number), path)
        print(f"{name} | {path} | {fault}", flush=True)  # noqa: T201
    seconds = time.monotonic() - begun
    print(f"{name}: {n} files, {n / seconds:.1f} a second, {len(known)} kinds of faults, {ends} shielded", flush=True)  # noqa: T201
    return row + collections.Counter({"tried": n})


def main():
    """Read changed files of all formats, or of those named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("formats", nargs="*")
    parser.add_argument("--minutes", type=float, default=1.0, help="in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kept", type=Path, default=Path("fuzzed"), help="folder for files that make a reader fail")
    given = parser.parse_args()
    apart.PATIENCE = 2.0
    rows = {}
    kept = given.kept.resolve()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        os.chdir(folder)
        every = formats(folder)
        chosen = {name: kind for name, kind in every.items() if not given.formats or name in given.formats}
        for name, kind in chosen.items():
            row = counted(name, kind, folder, kept, seed=given.seed, minutes=given.minutes / len(chosen))
            door = next((door for door, begin in DOORS.items() if re.match(begin, name)), "other files")
            rows[door] = rows.get(door, collections.Counter()) + row
    tell(rows)
    sys.exit(any(row.total() > row["tried"] for row in rows.values()))


if __name__ == "__main__":
    main()
