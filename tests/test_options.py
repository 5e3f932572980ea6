from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grainsdem.errors import InputError
from grainsdem.options import Note, Stored, checked, kind_of, model_of, notes_of, option, paths_of, told_of
from grainsdem.values import SMALLEST, ByName, shares

Share = Annotated[float, option("A share.", gt=0, le=1)]


def work(
    bed: str,
    *,
    share: Share,
    force: Annotated[float | None, option("A force.", "N", ge=0)] = None,
    count: Annotated[int, option("How many.", ge=1)] = 3,
    names: Annotated[Sequence[str] | None, option("Which.", min_length=1)] = None,
    way: Annotated[Literal["up", "down"], option("Which way.")] = "up",
    fast: Annotated[bool, option("Whether in haste.")] = False,
    path: str = "",
) -> None:
    """Take options and do nothing."""


MODEL = model_of(work, "work")


def slide(bed: str, *, walls: Annotated[ByName, option("How rough.")] = None) -> None:
    """Take one option and do nothing."""


@pytest.mark.unit
@pytest.mark.parametrize(
    ("given", "read"),
    [
        (None, None),
        (0.3, 0.3),
        (1, 1),
        ("0.3", 0.3),
        ("floor=0.6,wall_x0=0", {"floor": 0.6, "wall_x0": 0.0}),
        ("floor = 1", {"floor": 1.0}),
        ({"floor": 1}, {"floor": 1.0}),
    ],
)
def test_a_coefficient_may_be_one_or_several_by_name_and_a_text_of_either(given, read):
    assert checked(model_of(slide, "slide"), {"walls": given}) == {"walls": read}


@pytest.mark.unit
@pytest.mark.parametrize(
    ("given", "words"),
    [
        (-1.0, "walls: must be zero or more and finite; got -1.0"),
        (np.inf, "walls: must be zero or more and finite; got inf"),
        (
            "rough",
            "walls: must be zero or more and finite, or such numbers by name as floor=0.6,wall_x0=0; got 'rough'",
        ),
        ("floor=a", "as floor=0.6,wall_x0=0; got 'floor=a'"),
        ({"floor": -1}, r"as floor=0.6,wall_x0=0; got \{'floor': -1\}"),
        ({}, r"as floor=0.6,wall_x0=0; got \{\}"),
        (True, "walls: must be zero or more"),
        ([0.3], r"walls: must be zero or more and finite, or such numbers by name .*; got \[0.3\]"),
    ],
)
def test_coefficients_that_cannot_be_are_refused_in_one_line(given, words):
    with pytest.raises(InputError, match=words) as caught:
        checked(model_of(slide, "slide"), {"walls": given})
    assert "\n" not in str(caught.value)


@pytest.mark.unit
def test_coefficients_by_name_are_told_with_their_kind_and_range_and_have_a_schema():
    model = model_of(slide, "slide")
    told = told_of(model.model_fields["walls"], "walls")
    assert (told.kind, told.allowed) == ("float or table of float, optional", "at least 0")
    kinds = model.model_json_schema()["properties"]["walls"]["anyOf"]
    assert [kind["type"] for kind in kinds] == ["number", "object", "null"]


@pytest.mark.unit
def test_options_are_the_parameters_that_say_so_and_no_others():
    assert list(MODEL.model_fields) == ["share", "force", "count", "names", "way", "fast"]


@pytest.mark.unit
def test_what_is_not_given_has_its_default():
    expected = {"share": 0.5, "force": None, "count": 3, "names": None, "way": "up", "fast": False}
    assert checked(MODEL, {"share": 0.5}) == expected


@pytest.mark.unit
@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "share: missing"),
        ({"share": 0.0}, "share: input should be greater than 0; got 0.0"),
        ({"share": 1.5}, "share: input should be less than or equal to 1; got 1.5"),
        ({"share": "0.5"}, "share: input should be a valid number; got '0.5'"),
        ({"share": True}, "share: input should be a valid number; got True"),
        ({"share": np.nan}, "share: input should be a finite number; got nan"),
        ({"share": 0.5, "count": 2.0}, "count: input should be a valid integer; got 2.0"),
        ({"share": 0.5, "names": "one"}, "names: .* not allowed as a Sequence value; got 'one'"),
        ({"share": 0.5, "names": []}, "names: value should have at least 1 item"),
        ({"share": 0.5, "way": "left"}, "way: input should be 'up' or 'down'; got 'left'"),
        ({"share": 0.5, "fast": 1}, "fast: input should be a valid boolean; got 1"),
        ({"share": 0.5, "forec": 1}, "forec: unknown key; allowed are share, force, count, names, way, fast"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(values, words):
    with pytest.raises(InputError, match=words) as error:
        checked(MODEL, values)
    assert "\n" not in str(error.value)


@pytest.mark.unit
def test_numbers_of_numpy_and_tuples_are_taken_as_plain_ones():
    values = checked(MODEL, {"share": np.float32(0.5), "count": np.int64(2), "names": ("a", "b")})
    assert (values["share"], values["count"], values["names"]) == (0.5, 2, ["a", "b"])
    assert [type(values[name]) for name in ("share", "count")] == [float, int]


@pytest.mark.property
@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_range_lets_through_what_lies_in_it_and_nothing_else(value):
    try:
        found = checked(MODEL, {"share": value})["share"]
    except InputError:
        assert not SMALLEST <= value <= 1
    else:
        assert 0 < found == value <= 1


@pytest.mark.unit
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (float, "float"),
        (float | None, "float, optional"),
        (Literal["a", "b"], "{'a', 'b'}"),
        (Sequence[str], "sequence of str"),
        (list[str] | None, "list of str, optional"),
    ],
)
def test_a_type_is_told_in_the_words_of_numpydoc(kind, words):
    assert kind_of(kind) == words


def paint(
    *,
    picture: Annotated[str, option("What is painted.", is_path=True)] = "a.png",
    brush: Annotated[Callable | None, Note("callable, optional", "What with.")] = None,
) -> None:
    """Do nothing: only its signature is read."""


@pytest.mark.unit
def test_a_path_is_an_option_and_what_no_file_can_hold_is_only_noted():
    model = model_of(paint, "paint")
    assert list(model.model_fields) == paths_of(model) == ["picture"]
    assert notes_of(paint)["brush"][1] == ("callable, optional", "What with.")
    assert checked(model, {"picture": Path("b.png")}) == {"picture": "b.png"}
    with pytest.raises(InputError, match="brush: unknown key; allowed are picture"):
        checked(model, {"brush": print})


@pytest.mark.unit
@pytest.mark.parametrize(
    ("given", "read"),
    [("2650", 2650.0), ("0.3:0.5,0.6:0.5", {0.3: 0.5, 0.6: 0.5}), ({"0.3": 1}, {0.3: 1}), (0.4, 0.4), (None, None)],
)
def test_one_number_or_several_with_their_shares_are_read_from_texts_and_tables(given, read):
    assert shares(given) == read


@pytest.mark.unit
@pytest.mark.parametrize("given", ["rough", "0.3:half", "0.3:0.5,0.6", {"rough": 1.0}, {}])
def test_shares_that_cannot_be_are_refused_with_what_they_look_like(given):
    with pytest.raises(ValueError, match=r"numbers and their shares as 0.3:0.5,0.6:0.5"):
        shares(given)


@pytest.mark.unit
def test_what_python_takes_besides_is_no_option_of_a_file():
    def pour(
        *, weight: Annotated[float | Callable[[], float], Stored(float), option("How heavy.", gt=0)] = 1.0
    ) -> None:
        del weight

    model = model_of(pour, "pour", weight=2.0)
    assert checked(model, {}) == {"weight": 2.0}
    assert told_of(model.model_fields["weight"], "weight").allowed == "above 0"
    with pytest.raises(InputError, match="weight: input should be a valid number"):
        checked(model, {"weight": lambda: 1.0})
