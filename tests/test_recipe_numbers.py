from __future__ import annotations

import pytest

from grainsdem import recipe, survey
from grainsdem.cli.options import keyed
from grainsdem.errors import FileFormatError
from grainsdem.foreign import toml

pytestmark = pytest.mark.unit

BROKEN = {
    "digits": "rng = " + "9" * 4401,
    "deep lists": "a = " + "[" * 3000 + "]" * 3000,
    "deep tables": "a = " + "{a = " * 3000,
    "deep keys": ".".join("a" * 300) + " = 1",
    "deep header": "[" + ".".join("a" * 300) + "]",
    "open": "[seeds",
}


@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN)
def test_what_breaks_pythons_reader_is_one_line_of_ours(text, tmp_path):
    (tmp_path / "bed.toml").write_text(text)
    for read in (toml, recipe.parse):
        with pytest.raises(FileFormatError, match="not TOML") as told:
            read(text)
        assert "\n" not in str(told.value)
    for read in (recipe.read, survey.read):
        with pytest.raises(FileFormatError, match=r"bed\.toml: not TOML"):
            read(tmp_path / "bed.toml")


def test_tables_may_lie_within_one_another_as_far_as_is_told():
    def nested(depth):
        return "a = " + "[" * depth + "]" * depth

    assert toml(nested(40))
    with pytest.raises(FileFormatError, match="nested more than 50 deep"):
        toml(nested(60))


def test_an_option_that_is_no_toml_is_a_word():
    deep = "[" * 3000
    assert keyed(["a=[1,2]", f"b={deep}", "c=wet"]) == {"a": [1, 2], "b": deep, "c": "wet"}
    assert survey.parse_vary([f"seeds.count={'9' * 4401}"]) == {"seeds.count": ["9" * 4401]}


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ("[seeds]\ncount = 8\n[grains]\nscale = true\n", "grains.scale: input should be a valid number; got True"),
        ("[seeds]\ncount = true\n[grains]\nscale = 0.9\n", "seeds.count: input should be a valid number; got True"),
        ("[seeds]\ncount = 8\n[grains]\nvoid_ratio = '0.9'\n", "grains.void_ratio: input should be a valid number"),
        ("[seeds]\ncount = 8\n[grains]\ngap = 1e-308\n", r"grains.gap: input should be 0, or between 1e-30 and 1e\+30"),
        ("[seeds]\ncount = 8\n[grains]\nscale = inf\n", "grains.scale: input should be a finite number"),
        ("rng = 10000000000000000000000\n[seeds]\ncount = 8\n[grains]\nscale = 1\n", "rng: input should be at most 92"),
        (
            "[seeds]\ncount = 8\n[grains]\nscale = 1\n[tilt]\nmax_angle = 1e-300\n",
            "tilt.max_angle: input should be 0, or",
        ),
        ("[seeds]\nprocess = {a = 1}\ncount = 8\n[grains]\nscale = 1\n", "seeds.process: input should be 'halton'"),
        ("[seeds]\nprocess = [1]\ncount = 8\n[grains]\nscale = 1\n", "seeds.process: input should be 'halton'"),
        ("[seeds]\ncount = 8\n[grains]\nscale = 1\n[images]\nblur = [0, true]\n", "images.blur: a number or a range"),
    ],
)
def test_a_yes_a_text_or_what_breaks_arithmetic_is_no_number(tables, words):
    with pytest.raises(FileFormatError, match=words):
        recipe.parse(tables)
