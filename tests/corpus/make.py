"""Make the files of this folder that are not kept as they were found: ``python tests/corpus/make.py``.

``index.toml`` beside them tells what reads each, and the line that it must give; those that it tells nothing of a line
are read. Further files here were found by `fuzzing_files` and are kept as they are.
"""

from __future__ import annotations

import io
import json
import os
import struct
import sys
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conftest import cube_packing
from fuzzing_files import CASE

import exporters
import grainsdem as gd
from grainsdem import storage
from grainsdem.model import Surroundings
from grainsdem.storage.seals import seal

HERE = Path(__file__).resolve().parent

FACET = """facet normal 0 0 0
 outer loop
  vertex 0 0 0
  vertex 1 0 0
  vertex {} 1 0
 endloop
endfacet
"""

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

CLIPS = """clips = {{
        dictionary default = {{
            {}
            string primPath = "/g"
            double2[] active = [(0, 0)]
            double2[] times = [(0, 0)]
        }}
    }}"""

PATTERN = """string templateAssetPath = "./clip.#.usda"
            double templateStartTime = 0
            double templateEndTime = 1e9
            double templateStride = 0.001"""

BODY = """#usda 1.0
(
    {metadata}
    metersPerUnit = 1
)
def Xform "g" (
    prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
    {references}
)
{{
    {mass}
    def Mesh "shape"
    {{
        {points}
        {indices}
        int[] faceVertexCounts = [3, 3, 3, 3]
    }}
}}
"""

PARTS = {
    "metadata": "",
    "references": "",
    "mass": "float physics:mass = 1",
    "points": "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]",
    "indices": "int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]",
}

NOTED = """customLayerData = {{ dictionary grainsdem = {{ {} }} }}"""


def packings():
    """Packings in HDF5 that were changed and sealed again, or damaged."""
    path = HERE / "sound.h5"
    gd.save(cube_packing([[2, 2, 2], [5, 2, 2]], domain=gd.Domain.box((8, 4, 4))), path)
    sound = path.read_bytes()
    links = {
        "neighbors": np.full(12, -1, dtype=np.int32),
        "shifts": np.zeros((12, 3), dtype=np.int8),
        "cell_volumes": np.array([np.nan, 27.0]),
    }

    def put(name, values):
        def change(file):
            if name in file:
                del file[name]
            file[name] = values

        return change

    def tell(text):
        return lambda file: file.attrs.modify("provenance", text)

    def declare(file):
        del file["positions"]
        file.create_dataset("positions", (10**11, 3), dtype=float, chunks=(1000, 3))

    changes = {
        **{f"provenance-{k}": tell(text) for k, text in enumerate(("[1, 2]", '["x"]', '["{"]', '["{}"]', '["[]"]'))},
        "provenance-null": tell("[null]"),
        "provenance-markup": tell('["{\\"step\\":\\"[/bold]\\"}"]'),
        "wrapping-integers": put("grains/face_vertices", np.full(48, 2**62)),
        "density-below-zero": put("densities", [-1.0, 1.0]),
        "far-rotation": put("quaternions", np.full((2, 4), 1e308)),
        "link-of-nan": lambda file: [put(f"links/{name}", values)(file) for name, values in links.items()],
        "declared-long": declare,
        "complex-positions": put("positions", np.zeros((2, 3), dtype=complex)),
        "flat-positions": put("positions", np.zeros(6)),
        "soft-link": put("positions", h5py.SoftLink("/elsewhere")),
        "foreign-file": put("positions", h5py.ExternalLink("/etc/other.h5", "/x")),
    }
    for name, change in changes.items():
        place = HERE / f"{name}.h5"
        place.write_bytes(sound)
        with h5py.File(place, "r+") as file:
            change(file)
        seal(place)
    flipped = bytearray(sound)
    flipped[200] ^= 1
    (HERE / "sealed-flipped.h5").write_bytes(flipped)
    (HERE / "sealed-cut.h5").write_bytes(sound[:-5])
    bare = bytearray(sound[: sound.rindex(b"\ngrainsdem sha256")])
    (HERE / "before-seals.h5").write_bytes(bare)
    bare[28] ^= 64
    (HERE / "bare-flipped.h5").write_bytes(bare)
    path.unlink()


def histories():
    """Histories whose arrays are of other shapes."""
    path = HERE / "series-flat.h5"
    with storage.HistoryWriter(path, ["time"]):
        pass
    with h5py.File(path, "r+") as file:
        del file["series"]
        file["series"] = np.zeros(3)
    seal(path)
    path = HERE / "one-place.h5"
    lid = Surroundings(
        ("lid",), np.eye(3), [[0, 1, 2]], np.zeros(3), *(np.ones((1, 1, k)) for k in (3, 4)), np.ones((1, 3))
    )
    with storage.HistoryWriter(path, ["time"], n_grains=1, around=lid) as history:
        around = lid.positions[0], lid.quaternions[0], lid.gravity[0]
        history.append_frame(0, positions=np.ones((1, 3)), quaternions=np.ones((1, 4)), around=around)
    with h5py.File(path, "r+") as file:
        del file["surroundings/positions"]
        file["surroundings/positions"] = 1.0
    seal(path)


def surfaces():
    """STL, OBJ and PLY."""
    solid = "solid {}\n{}endsolid\n"
    told = {
        "one-triangle.stl": solid.format("a", FACET.format(0)),
        "not-a-number.stl": solid.format("a", FACET.format("nan")),
        "unit-zero.stl": solid.format("a unit 0 m", FACET.format(0)),
        "unit-below-zero.stl": solid.format("a unit -1 m", FACET.format(0)),
        "unit-hexadecimal.stl": solid.format("a unit 0x10 m", FACET.format(0)),
        "facet-before-solid.stl": "solidly\n" + FACET.format(0),
        "ends-in-a-facet.stl": "solid a\nfacet\nouter loop\nvertex 0 0 0\n",
        "unit-bare.obj": f"# unit\n{TETRAHEDRON}",
        "unit-word.obj": f"# unit abc\n{TETRAHEDRON}",
        "unit-hexadecimal.obj": f"# unit 0x10 m\n{TETRAHEDRON}",
        "unit-zero.obj": f"# unit 0 m\n{TETRAHEDRON}",
        "unit-below-zero.obj": f"# unit -1 m\n{TETRAHEDRON}",
        "index-beyond.obj": TETRAHEDRON + f"f 1 2 {2**63}\n",
        "index-of-digits.obj": TETRAHEDRON + f"f 1 2 {'9' * 5000}\n",
        "not-a-number.obj": TETRAHEDRON.replace("v 1", "v nan"),
        "far.obj": TETRAHEDRON.replace("v 1", "v 1e300"),
        "not-a-number.ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n",
    }
    for name, text in told.items():
        (HERE / name).write_text(text)
    corners = struct.pack("<12fH", *[0.0] * 3, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    (HERE / "unit-word.stl").write_bytes(b"grainsdem, unit abc".ljust(80) + struct.pack("<I", 1) + corners)


def stages():
    """USD as text, and a crate with a bit turned."""
    lower = "double3 domainLower = (0, 0, 0)"
    changes = {
        "no-points": {"points": ""},
        "empty-points": {"points": "point3f[] points = []"},
        "points-of-text": {"points": 'string[] points = ["a"]'},
        "no-indices": {"indices": ""},
        "indices-beyond": {"indices": PARTS["indices"].replace("[0,", "[9,")},
        "mass-below-zero": {"mass": "float physics:mass = -5"},
        "no-upper-corner": {"metadata": NOTED.format(lower)},
        "domain-of-text": {"metadata": 'customLayerData = { string grainsdem = "x" }'},
        "corner-of-text": {
            "metadata": NOTED.format(f'{lower}\nstring domainUpper = "x"\nint[] domainPeriodic = [0, 0, 0]')
        },
        "foreign-sublayer": {"metadata": "subLayers = [@../../outside.usda@]"},
        "foreign-reference": {"references": "prepend references = @/etc/outside.usda@</x>"},
        "foreign-payload": {"references": "prepend payload = @../../outside.usda@</x>"},
        "foreign-by-name": {
            "metadata": 'expressionVariables = { string where = "/etc/outside.usda" }\nsubLayers = [@`"${where}"`@]'
        },
        "foreign-clips": {"references": CLIPS.format("asset[] assetPaths = [@../../outside.usda@]")},
        "foreign-manifest": {"references": CLIPS.format("asset manifestAssetPath = @../../outside.usda@")},
        "endless-clips": {"references": CLIPS.format(PATTERN)},
        "foreign-texture": {"mass": "asset inputs:file = @/etc/outside.png@"},
        "mass-of-file": {"mass": "asset physics:mass = @./mass.txt@"},
        "unit-of-zero": {"metadata": "kilogramsPerUnit = 0"},
    }
    for name, change in changes.items():
        (HERE / f"{name}.usda").write_text(BODY.format(**{**PARTS, **change}))
    path = HERE / "flipped.usdc"
    exporters.write(cube_packing([[2, 2, 2]], domain=gd.Domain.cube(4)), path, overwrite=True)
    crate = bytearray(path.read_bytes())
    crate[20] ^= 8
    path.write_bytes(crate)


def scenes():
    """MJCF."""
    mesh = '<mesh name="m" vertex="0 0 0 1 0 0 0 1 0 {}"/>'
    body = '<body name="g"><freejoint/><geom type="mesh" mesh="m"/></body>'
    scene = f"<mujoco>{{}}<asset>{mesh}</asset><worldbody>{body}</worldbody></mujoco>"
    entity = '<!DOCTYPE mujoco [<!ENTITY a "b"><!ENTITY c SYSTEM "file:///etc/passwd">]>'
    told = {
        "entity.xml": entity + scene.format("", "0 0 1"),
        "foreign-include.xml": scene.format('<include file="../../outside.xml"/>', "0 0 1"),
        "flat-mesh.xml": scene.format("", "1 1 0"),
        "not-a-number.xml": scene.format("", "nan 0 1"),
    }
    for name, text in told.items():
        (HERE / name).write_text(text)


def numbers():
    """Points, sizes and images."""
    head = "{{'descr': {}, 'fortran_order': False, 'shape': {}, }}"

    def array(descr, shape, body=b""):
        text = head.format(descr, shape).encode().ljust(117) + b"\n"
        return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + body

    (HERE / "declared-long.npy").write_bytes(array("'<f8'", "(3000000000, 3)"))
    (HERE / "objects.npy").write_bytes(array("'|O'", "(3,)", b"\x80\x03N."))
    (HERE / "complex.npy").write_bytes(array("'<c16'", "(1, 3)", bytes(48)))
    (HERE / "below-zero.npy").write_bytes(array("'<f8'", "(-1, 3)", bytes(48)))
    (HERE / "open-bracket.npy").write_bytes(array("'<f8'", "((3, 3)", bytes(72)))
    (HERE / "escape.npy").write_bytes(array("'\\{'", "(3, 3)", bytes(72)))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("points.npy"), array("'<f8'", "(9, 3)", bytes(216)))
    flipped = bytearray(packed.getvalue())
    flipped[50] ^= 255
    (HERE / "flipped.npz").write_bytes(flipped)
    (HERE / "digits.txt").write_text("9" * 9000 + "x\n")
    (HERE / "digits.csv").write_text(f"1,{'9' * 5000},0\n")
    size = struct.pack(">II", 100_000, 100_000) + b"\x08\x00\x00\x00\x00"

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    image = chunk(b"IHDR", size) + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")
    (HERE / "large.png").write_bytes(b"\x89PNG\r\n\x1a\n" + image)


def tables():
    """TOML, CSV and JSON."""
    grains = "[seeds]\ncount = 8\n[grains]\n{}\n"
    told = {
        "digits.toml": f"[seeds]\ncount = {'9' * 4301}\n",
        "nested.toml": f"a = {'[' * 1000}{']' * 1000}\n",
        "dotted.toml": f"{'.'.join(['a'] * 2000)} = 1\n",
        "void-ratio-true.toml": grains.format("void_ratio = true"),
        "scale-true.toml": grains.format("scale = true"),
        "law-of-nothing.toml": grains.format(
            'sizes = {law = "lognorm", parameters = {s = 0.3, scale = -0.0}, tolerance = 0.05}'
        ),
        "dotted-survey.toml": f"[seeds]\n{'.'.join(['a'] * 2000)} = 1\n[survey]\nrepeats = 1\n",
        "survey-digits.csv": f"case,a\n0,{'9' * 30}\n",
        "survey-empty.csv": "",
        "survey-nameless.csv": "case,\n0,1\n",
        "long-field.csv": f"sieve (mm),passing (%)\n{'9' * 140_000},1\n",
        "case-list.json": "[]",
        "case-nested.json": "[" * 5000,
        "case-cut.json": '{"axis": ',
        "case-axis.json": '{"axis": "w"}',
        "case-pressure.json": json.dumps({**CASE, "kinematic_pressure_drop": 0}),
    }
    for name, text in told.items():
        (HERE / name).write_text(text)


if __name__ == "__main__":
    os.chdir(HERE)
    for make in (packings, histories, surfaces, stages, scenes, numbers, tables):
        make()
