"""The door of every public function, and calls of all of them with what they cannot take."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

import fuzzing
import numpy as np
import pytest

import grainsdem as gd
from grainsdem.dynamics.experiments import registry
from grainsdem.errors import ArgumentError, GrainsDEMError, InputError, ShapeError, shown
from grainsdem.gate import checks_of, gated, gated_noun, shapes_of
from grainsdem.memory import allow_memory

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

pytestmark = pytest.mark.unit

FUNCTIONS = fuzzing.functions()
STRUCTURAL = {"colors", "options", "relation", "drive", "region", "color_by"}
"""Arguments that are known by what they can do, or by more than one kind of which one is no type."""


@gated
def weigh(
    points: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    n: int = 1,
    size: float = 1.0,
    keep: Literal["all", "inside"] = "all",
    is_old: bool = False,
    rng: np.random.Generator | int | None = None,
) -> tuple[object, ...]:
    """Return what is given.

    Parameters
    ----------
    points : array_like, shape (n, 3) or (n, 2)
        Rows.
    weights : array_like, shape (n,), optional
        One a row.

    Returns
    -------
    tuple
        All of it.
    """
    return points, weights, n, size, keep, is_old, rng


def test_numbers_and_arrays_of_other_kinds_become_those_of_python_and_numpy():
    points, weights, n, size, *_ = weigh(
        [[1, 2, 3]], (4,), n=np.int8(3), size=np.float32(0.5), is_old=np.bool_(True), rng=np.int64(3)
    )
    assert isinstance(points, np.ndarray)
    assert isinstance(weights, np.ndarray)
    assert (type(n), type(size)) == (int, float)


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"points": None}, ShapeError, "points must be an array of numbers; got None"),
        ({"points": "abc"}, ShapeError, "points must be an array of numbers; got 'abc'"),
        ({"points": [[1, 2], [3]]}, ShapeError, "rows of unlike lengths"),
        ({"points": [1j, 2]}, ShapeError, "got complex numbers"),
        ({"points": [["a", "b", "c"]]}, ShapeError, "got values of type <U1"),
        ({"points": [[None, 1, 2]]}, ShapeError, "got objects, the first of type NoneType"),
        ({"points": [1, 2, 3]}, ShapeError, r"of shape \(n, 3\) or \(n, 2\); got shape \(3,\)"),
        ({"weights": [1, 2]}, ShapeError, r"shape \(n,\); got shape \(2,\) beside points of shape \(1, 3\)"),
        ({"n": 1.5}, ArgumentError, "n must be a whole number; got 1.5"),
        ({"n": True}, ArgumentError, "n must be a whole number; got True"),
        ({"size": "3"}, ArgumentError, "size must be a number; got '3'"),
        ({"size": True}, ArgumentError, "size must be a number; got True"),
        ({"size": 10**400}, ArgumentError, "size must be a number; got 1000"),
        ({"size": 10**5000}, ArgumentError, "got a number of thousands of digits"),
        ({"keep": "none"}, ArgumentError, "keep must be 'all' or 'inside'; got 'none'"),
        ({"keep": ["all"]}, ArgumentError, r"got \['all'\]"),
        ({"is_old": 1}, ArgumentError, "is_old must be true or false; got 1"),
        ({"rng": -1}, ArgumentError, "a whole number of at least 0, or None; got -1"),
        ({"rng": 1.0}, ArgumentError, "got 1.0"),
    ],
)
def test_what_an_argument_cannot_be_is_told_in_one_line(given, error, words):
    with pytest.raises(error, match=words) as told:
        weigh(**{"points": [[1, 2, 3]], **given})
    assert "\n" not in str(told.value)
    assert isinstance(told.value, ValueError)


def test_a_wrong_kind_is_the_type_error_that_python_would_raise_too():
    with pytest.raises(TypeError):
        gd.diameters(None)
    with pytest.raises(InputError):
        gd.diameters(None)


def test_a_gated_function_looks_as_it_is_written():
    assert inspect.signature(weigh).parameters.keys() == {
        "points", "weights", "n", "size", "keep", "is_old", "rng",
    }  # fmt: skip
    assert weigh.__name__ == "weigh"
    assert weigh.__doc__.startswith("Return what is given.")


def test_shapes_are_those_of_the_docstring(monkeypatch):
    shapes = {"points": [("n", "3"), ("n", "2")], "weights": [("n",)]}
    assert shapes_of(weigh) == shapes
    # Python 3.13 takes the indent away.
    monkeypatch.setattr(weigh, "__doc__", inspect.cleandoc(weigh.__doc__))
    assert shapes_of(weigh) == shapes
    assert shapes_of(gd.carve) == {"density": [(), ("n_cells",)], "classes": [("n_cells",)]}
    assert shapes_of(gd.fit_sieves) == {"bounds": [("k + 1",)], "counts": [("k",)]}
    assert shapes_of(gd.points.noise_field) == {}  # a length for each axis: only the function can count them


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_has_the_door_and_it_knows_each_of_its_types(name):
    function = FUNCTIONS[name]
    assert hasattr(function, "__wrapped__")
    known = checks_of(function)
    options = registry.find(function.__name__).options.model_fields if name.split(".")[-1] in registry.BUILT_IN else {}
    described = {"friction", "wall_friction", "density"} if function.__name__ == "settle" else set()
    free = {p.name for p in inspect.signature(function).parameters.values() if p.kind is p.VAR_KEYWORD}
    unknown = inspect.signature(function).parameters.keys() - known.keys() - options.keys() - described - free
    assert unknown <= STRUCTURAL


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return str(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_is_of_no_kind_that_a_function_takes_gets_one_line(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    function = FUNCTIONS[name]
    valid = fuzzing.valid(name, function, folder)
    wrong = {}
    for argument in set(valid) & set(checks_of(function)):
        for word in ("object", "complex", "set", "list of None"):
            with pytest.raises(GrainsDEMError) as told:
                function(**{**valid, argument: fuzzing.KINDS[word]})
            if "\n" in str(told.value) or argument not in str(told.value):
                wrong[argument, word] = str(told.value)
    assert wrong == {}


def test_odd_values_of_what_nouns_are_made_of_get_one_line(folder, monkeypatch):
    monkeypatch.chdir(folder)
    tried = list(fuzzing.tried(folder, (), fuzzing.constructors(), every=3))
    assert len({name for name, *_ in tried}) > 25
    assert [found for found in tried if found[-1]] == []


def test_every_public_method_that_takes_something_has_the_door_and_is_tried(folder):
    found = fuzzing.methods(folder)
    assert {"gd.Domain.contains", "gd.Grading.draw", "gd.Polyhedra.faces_of", "gd.Packing.with_step"} <= set(found)
    assert [name for name, method in found.items() if method is None] == []
    for name, method in found.items():
        assert hasattr(method, "__wrapped__"), name
        parameters = inspect.signature(method).parameters.values()
        unknown = {one.name for one in parameters if one.kind is not one.VAR_KEYWORD} - checks_of(method).keys()
        assert unknown == set(), name
        assert fuzzing.outcome(method, fuzzing.valid(name, method, folder)) is None


def test_a_noun_holds_what_its_own_methods_take_from_the_day_it_is_made():
    @gated_noun
    @dataclass(frozen=True, slots=True)
    class Box:
        side: float

        def within(self, points: ArrayLike) -> object:
            """Return points, shape (n, 3)."""
            return points

        def held(self, point: float) -> float:  # for itself alone
            return point

        @classmethod
        def of(cls, side: float) -> Self:
            """Return one."""
            return cls(side)

    with pytest.raises(ArgumentError, match="side must be a number; got 'a'"):
        Box.of("a")
    with pytest.raises(ShapeError, match="points must be an array of numbers; got None"):
        Box(1.0).within(None)
    with pytest.raises(ShapeError, match=r"points must be .* of shape \(n, 3\); got shape \(2,\)"):
        Box(1.0).within([1, 2])
    assert np.shape(Box(1.0).within([])) == (0, 3)
    assert Box(1.0).held("a") == "a"
    assert Box.within.__doc__ == "Return points, shape (n, 3)."


def test_odd_values_of_what_methods_take_get_one_line(folder, monkeypatch):
    monkeypatch.chdir(folder)
    tried = list(fuzzing.tried(folder, (), fuzzing.methods(folder)))
    assert len({name for name, *_ in tried}) > 40
    assert [found for found in tried if found[-1]] == []


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda p: p["packing"].grains.vertices_of(-1), "i must be one of 27, counted from 0; got -1"),
        (lambda p: p["packing"].grains.faces_of(27), "i must be one of 27, counted from 0; got 27"),
        (lambda p: p["gd.Packing"].classes_of(np.array([27])), "some of 27, counted from 0, or a mask of so many; got"),
        (lambda p: p["ContactGraph"].select([0.5]), r"got float64 of shape \(1,\) from 0.5 to 0.5"),
        (lambda p: p["packing"].with_step("x", a=object()), "JSON values; Object of type object"),
        (lambda p: p["Domain"].scaled(0), "factor must be 1e-30 to 1e\\+30; got 0"),
        (lambda p: p["metric"].forward([[np.inf, 0, 0]]), "points must be numbers within ±1e\\+30; 1 of 3 are not"),
        (lambda p: p["lens"].nearest(np.zeros((3, 8))), r"the lens's shape, \(8, 8\); got \(3, 8\)"),
        (lambda p: p["curve"].draw(9, power=2**62), "power must be 3, or 2 in a plane"),
        (lambda p: p["curve"].draw(2**62), "grains would take .* GB"),
        (lambda p: p["ensemble"].curve("time", "strain"), "the histories have time, energy; got 'strain'"),
    ],
)
def test_methods_tell_what_is_out_of_their_range(folder, call, told):
    with pytest.raises(InputError, match=told):
        call(fuzzing.pool(folder))


def test_laws_of_sizes_go_on_to_their_ends():
    law = gd.LogHyperbolic(2.0, 0.5, 0.3, -7.0)
    assert law.cdf([0.0, np.inf]).tolist() == [0.0, 1.0]
    assert law.log_density([0.0, np.inf]).tolist() == [-np.inf, -np.inf]
    assert np.isnan([law.cdf(np.nan), law.log_density(np.nan)]).all()


def test_numbers_that_python_alone_holds_are_refused(folder):
    packing = fuzzing.pool(folder)["packing"]
    for call, words in (
        (lambda: gd.settle(packing, friction=10**4400), "friction must be .* got a number of thousands of digits"),
        (lambda: gd.settle(packing, wall_friction=10**4400), "wall_friction must be zero or more and finite"),
        (lambda: gd.dynamics.tap(packing, taps=10**4400), "taps: input should be at most 9223372036854775807"),
        (lambda: gd.placed_cells(gd.Domain.cube(), lambda x, *_: x + 1, n=2**62), "cells"),
        (lambda: gd.section_profile(packing, 10**7), "from one to 100000 levels; got 10000000"),
    ):
        with pytest.raises(InputError, match=words):
            call()


@pytest.mark.parametrize("lengths", [(1e-308,) * 3, (1e308,) * 3, (1e-3, 1e-3, 1e30), (1e-3, 1e-3, 1e9)])
def test_a_domain_of_no_size_that_matter_has_is_refused(lengths):
    with pytest.raises(InputError, match="edges must be between 1e-30 and 1e\\+30 m"):
        gd.Domain.box(lengths)


@pytest.mark.parametrize("diameter", [1e-308, 1e-31, 1e31, 1e308])
def test_shapes_of_no_size_that_matter_has_are_refused(diameter):
    with pytest.raises(InputError, match="1e-30 to 1e\\+30 m"):
        gd.shapes.rock(diameter=diameter)
    with pytest.raises(InputError, match="must be positive and finite"):
        gd.shapes.sized(gd.shapes.platonic("cube"), diameter)


def test_vertices_beyond_all_lengths_are_refused():
    cube = gd.shapes.platonic("cube")
    with pytest.raises(InputError, match="within 1e\\+30 m of the origin"):
        gd.Polyhedra(
            cube.vertices * 1e40, cube.vertex_offsets, cube.face_offsets, cube.face_vertices, cube.face_vertex_offsets
        )


@pytest.mark.parametrize(
    "make",
    [
        lambda domain: gd.points.poisson(domain, 2**62),
        lambda domain: gd.points.poisson(domain, 10**15),
        lambda domain: gd.points.halton(domain, 10**15),
        lambda domain: gd.points.strauss(domain, 10**13, distance=0.1, inhibition=0.5),
        lambda domain: gd.points.strauss_process(domain, distance=0.1, inhibition=0.5, intensity=1e300),
        lambda domain: gd.points.pink_noise(domain, 10, resolution=10**9),
        lambda _: gd.points.noise_field((2**40, 2**40), 1.0),
    ],
)
def test_what_no_memory_holds_is_refused_before_it_is_made(make):
    with pytest.raises(InputError, match=r"would take .* GB, .* GRAINSDEM_MEMORY, in GB, raises the limit"):
        make(gd.Domain.cube())


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda domain: gd.points.poisson(domain, 10**4400), "must be a whole number; got one beyond 64 bits"),
        (
            lambda domain: gd.relax([[0.5, 0.5, 0.5]], domain, iterations=10**6),
            "iterations must be zero or more, at most",
        ),
        (
            lambda domain: gd.sized_cells(domain, [1.0, 2.0], relaxations=10**9),
            "relaxations must be zero or more, at mo",
        ),
        (
            lambda domain: gd.tessellate([[0.5, 0.5, 0.5]], domain, weights=1e308),
            "weights must be within ±1e.60 m²; 1 are",
        ),
        (lambda domain: gd.points.scaled(np.full((2, 3), 1e308), domain), "points must be finite"),
        (lambda _: gd.load(""), "path must be a path; got an empty one"),
        (lambda _: gd.fabric_tensor([[1, 0, 0]], weights=[]), r"weights must be .* shape \(m,\); got shape \(0,\)"),
        (lambda _: gd.fabric_tensor([[1, 0, 0]], weights=[float("nan")]), "weights must be finite and zero or more"),
        (lambda _: gd.anisotropy([]), r"tensor must be an array of numbers of shape \(3, 3\); got shape \(0,\)"),
    ],
)
def test_what_would_never_end_or_is_empty_gets_one_line(make, told):
    with pytest.raises(InputError, match=told) as caught:
        make(gd.Domain.cube())
    assert "\n" not in str(caught.value)


def test_the_words_of_an_error_are_one_line():
    assert str(InputError(f"it must be flat; got {np.zeros((2, 2))}")) == "it must be flat; got [[0. 0.] [0. 0.]]"
    assert str(InputError("as  it  was")) == "as  it  was"


def test_directions_of_any_length_have_one_tensor():
    axes = np.eye(3) * [[1e308], [1e-308], [1.0]]
    assert gd.fabric_tensor(axes) == pytest.approx(np.eye(3) / 3)


def test_the_limit_of_memory_can_be_set(monkeypatch):
    monkeypatch.setenv("GRAINSDEM_MEMORY", "1e-6")
    with pytest.raises(InputError, match="20 seeds would take 2e-06 GB, and 1e-06 GB may be taken here"):
        gd.points.poisson(gd.Domain.cube(), 20)
    monkeypatch.setenv("GRAINSDEM_MEMORY", "much")
    with pytest.raises(InputError, match="must be a number of GB above 0; got 'much'"):
        allow_memory(1, 1, "seeds")


def test_a_chain_that_would_take_days_is_refused():
    with pytest.raises(InputError, match="a chain of at most 1e\\+11 steps"):
        gd.points.strauss_process(gd.Domain.cube(), 10, distance=0.1, inhibition=0.5, sweeps=10**18)


def test_values_are_shown_short_and_in_one_line():
    assert shown(np.float32(0.5)) == "0.5"
    assert shown("x" * 200).endswith("…")
    assert "\n" not in shown([np.eye(5)])
