"""Every measure in the public window takes a packing or, where grains alone are enough, its grains."""

from __future__ import annotations

import ast
import inspect
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from solids import place, polyhedra, solid

import grainsdem
from grainsdem.errors import InputError
from grainsdem.measures import diameters, ellipsoid_axes, masses, porosity, sphericities, summary, table
from grainsdem.measures.sections import expected_section
from grainsdem.model import Domain, Polyhedra
from grainsdem.packing import carve
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate

ROOMS = ("measures", "measures.planform", "measures.sections", "measures.voxels", "geometry.integrals")


def window():
    """Return the measures among the public names: those of grains, and those that need a packing."""
    tree = ast.parse(Path(grainsdem.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    names = [
        a.name for node in tree.body if isinstance(node, ast.ImportFrom) and node.module in ROOMS for a in node.names
    ]
    functions = {name: getattr(grainsdem, name) for name in names if inspect.isfunction(getattr(grainsdem, name))}
    parameters = {name: inspect.signature(function).parameters.values() for name, function in functions.items()}
    of_grains = {
        name: f for name, f in functions.items() if any("Grains" in str(p.annotation) for p in parameters[name])
    }
    of_packings = {
        name: f
        for name, f in functions.items()
        if any(p.name == "packing" and p.default is p.empty for p in parameters[name])
    }
    return of_grains, of_packings


OF_GRAINS, OF_PACKINGS = window()


@pytest.mark.unit
def test_the_window_holds_the_measures_that_are_meant():
    assert {"volumes", "integrate", "face_planes", "diameters", "sphericities", "sieve_diameters"} <= OF_GRAINS.keys()
    assert {"box_axes", "ellipsoid_axes", "mean_widths", "centroids", "inertia_tensors"} <= OF_GRAINS.keys()
    assert {"masses", "table", "summary", "porosity", "widths", "section", "planform", "voxelize"} <= OF_PACKINGS.keys()
    assert not OF_GRAINS.keys() & OF_PACKINGS.keys()


@pytest.mark.unit
@pytest.mark.parametrize("name", OF_GRAINS)
def test_what_is_measured_of_grains_is_the_same_of_a_packing_and_of_its_grains(name, poured):
    measure = OF_GRAINS[name]
    found, alone = measure(poured), measure(poured.grains)
    parts = zip(found, alone, strict=True) if isinstance(found, tuple) else [(found, alone)]
    for a, b in parts:
        np.testing.assert_array_equal(a, b)
    with pytest.raises(InputError, match="must be a Packing or its Polyhedra; got something of type ndarray"):
        measure(np.ones((4, 3)))


@pytest.mark.unit
@pytest.mark.parametrize("name", OF_PACKINGS)
def test_what_needs_a_packing_says_so_where_it_is_given_the_grains_alone(name, cube, tmp_path):
    measure = OF_PACKINGS[name]
    others = {"path": tmp_path / "a.npy", "folder": tmp_path, "direction": [1, 0, 0], "formats": ("png",)}
    words = {
        p.name: cube.grains if p.name == "packing" else others.get(p.name)
        for p in inspect.signature(measure).parameters.values()
        if p.default is p.empty and p.kind is not p.VAR_KEYWORD
    }
    # First of all, so that it is what is told.
    words = {"packing": words["packing"], **words}
    with pytest.raises(InputError, match="packing must be a Packing; got something of type Polyhedra"):
        measure(**words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.unit
def test_of_a_planar_packing_diameters_and_sphericities_are_those_in_the_plane_as_in_its_table():
    domain = Domain.slab((1.0, 1.0), 0.01)
    bed = carve(tessellate(poisson(domain, 30, rng=3), domain), keep="all")
    rows = table(bed)
    np.testing.assert_array_equal(diameters(bed), rows["diameter"])
    np.testing.assert_array_equal(sphericities(bed), rows["sphericity"])
    assert (diameters(bed) > diameters(bed.grains)).all()  # thin prisms: their spheres are small


def inside_out(shapes, which):
    """Return the same polyhedra, some with all faces turned around."""
    corners = np.array(shapes.face_vertices)
    cuts = shapes.face_vertex_offsets
    for i in which:
        for f in range(shapes.face_offsets[i], shapes.face_offsets[i + 1]):
            corners[cuts[f] : cuts[f + 1]] = corners[cuts[f] : cuts[f + 1]][::-1]
    return Polyhedra(shapes.vertices, shapes.vertex_offsets, shapes.face_offsets, corners, cuts)


@pytest.mark.unit
@pytest.mark.parametrize("measure", [diameters, sphericities, ellipsoid_axes, masses, table, summary, expected_section])
def test_sizes_and_shapes_of_a_grain_that_is_inside_out_are_refused_and_name_it(measure):
    good = polyhedra(*[solid("cube").vertices] * 3)
    bed = place(inside_out(good, [1]), [[1, 1, 1], [3, 1, 1], [5, 1, 1]])
    with pytest.raises(InputError, match=r"above zero, .*; 1 of 3 have not: 1 \(of the first it is -1 m3\)"):
        measure(bed)
    np.testing.assert_allclose(grainsdem.volumes(bed), [1, -1, 1])  # a volume has a sign, and says what is wrong


@pytest.mark.unit
def test_a_grain_without_volume_has_no_size_and_one_that_is_inside_out_is_in_no_porosity():
    flat = Polyhedra(np.zeros((4, 3)), [0, 4], [0, 1], [0, 1, 2], [0, 3])
    bed = place(flat, [[1.0, 1, 1]])
    for measure in (diameters, sphericities, ellipsoid_axes, masses):
        with pytest.raises(InputError, match=r"1 of 1 have not: 0 \(of the first it is 0 m3\)"):
            measure(bed)
    domain = Domain.cube()
    cells = carve(tessellate(poisson(domain, 9, rng=1), domain), keep="all")
    with pytest.raises(InputError, match="1 of 9 have not: 4"):
        porosity(replace(cells, grains=inside_out(cells.grains, [4])))
