from __future__ import annotations

import io
import pickle
import subprocess
import sys

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import GrainsDEMError
from grainsdem.geometry.pairs.bodies import standing
from grainsdem.geometry.separation import bodies, offsets_between
from grainsdem.validation import intersections, worker
from grainsdem.validation.intersections import intersection_volumes


def rods(n=7):
    """Cubes in a line, each reaching into the next by k per cent of its edge."""
    steps = np.cumsum([0] + [2 * (1 - 0.01 * k) for k in range(1, n)])
    return cube_packing(np.column_stack([steps, np.zeros(n), np.zeros(n)]))


def arguments(packing):
    pairs = np.column_stack([np.arange(len(packing) - 1), np.arange(1, len(packing))]).astype(np.int32)
    return packing.grains, bodies(packing), pairs, offsets_between(packing, pairs)


@pytest.mark.client
@pytest.mark.parametrize("processes", [None, 1, 2])
def test_volumes_come_out_the_same_in_this_process_and_in_others(processes, monkeypatch):
    monkeypatch.setattr(intersections, "BLOCK", 2)
    seen = []
    found = intersection_volumes(
        *arguments(rods()), processes=processes, progress=lambda done, total: seen.append((done, total))
    )
    np.testing.assert_allclose(found, 8 * 0.01 * np.arange(1, 7), rtol=1e-12)
    done = [each for each, total in seen if total == 6]
    assert done == sorted(set(done))
    assert (len(done), done[-1]) == (4 if processes == 2 else 3, 6)


@pytest.mark.client
def test_the_unit_of_length_changes_nothing():
    grains, solids, pairs, offsets = arguments(rods())
    plain = intersection_volumes(grains, solids, pairs, offsets)
    np.testing.assert_allclose(intersection_volumes(grains, solids, pairs, offsets, length=1e-4), plain, rtol=1e-12)


@pytest.mark.client
def test_a_mesh_that_manifold3d_does_not_accept_has_no_volume_to_share():
    _, solids, pairs, offsets = arguments(rods(3))
    block = (
        np.arange(3),
        *standing(solids, np.arange(3)), np.array([[0, 2, 1]] * 3, np.uint64), np.array([0, 1, 2, 3]),
        pairs.astype(np.int64), offsets,
    )  # fmt: skip
    assert np.isnan(worker.run(block, {})).all()


@pytest.mark.client
def test_a_worker_answers_blocks_until_its_input_ends():
    grains, solids, pairs, offsets = arguments(rods(3))
    mesh = intersections.triangles(grains)
    block = intersections._block(solids, mesh, pairs, offsets, 1.0)
    sink = io.BytesIO()
    worker.serve(io.BytesIO(pickle.dumps(block) * 2), sink)
    sink.seek(0)
    for _ in range(2):
        answer = pickle.load(sink)  # noqa: S301  (written two lines above)
        np.testing.assert_allclose(answer, [0.08, 0.16], rtol=1e-12)


@pytest.mark.client
def test_processes_start_from_a_script_without_a_main_guard(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import numpy as np\n"
        "from grainsdem.geometry.separation import bodies\n"
        "from grainsdem.validation.intersections import intersection_volumes\n"
        "from grainsdem.model import Domain, Packing, Polyhedra\n"
        "t = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
        "f = [0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2]\n"
        "shapes = Polyhedra(t + t, [0, 4, 8], [0, 4, 8], f + f, range(0, 25, 3))\n"
        "packing = Packing(shapes, np.zeros((2, 3)), [[1, 0, 0, 0]] * 2, [1, 1], Domain())\n"
        "pairs = np.array([[0, 1]], np.int32)\n"
        "print(intersection_volumes(shapes, bodies(packing), pairs, np.zeros((1, 3)), processes=2)[0] * 6)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(1, rel=1e-12)


@pytest.mark.client
def test_a_process_that_dies_is_an_error_and_no_endless_wait(monkeypatch):
    monkeypatch.setattr(intersections, "BLOCK", 2)
    monkeypatch.setattr(intersections.sys, "executable", "/bin/false")
    with pytest.raises(GrainsDEMError, match="ended before its work was done"):
        intersection_volumes(*arguments(rods()), processes=2)
