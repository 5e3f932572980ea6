from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from typer.main import get_command

from grainsdem.cli import app

pytestmark = pytest.mark.example

ROOT = Path(__file__).parent.parent
SCRIPTS = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))
README = (ROOT / "README.md").read_text(encoding="utf-8")


def run(*words, folder):
    # As users start them: an example may take another one that lies beside it.
    env = {key: value for key, value in os.environ.items() if key != "PYTHONSAFEPATH"}
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=env, capture_output=True, text=True, check=True
    ).stdout


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """A function: what an example prints when it runs quickly; each runs once."""

    @cache
    def run_quickly(name):
        return run(str(ROOT / "examples" / f"{name}.py"), "--quick", folder=tmp_path_factory.mktemp(name))

    return run_quickly


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS)
def test_every_example_runs_quickly_and_prints_something(script, printed):
    assert printed(script).strip()


@pytest.mark.parametrize(
    "script", [pytest.param("figure_03_12_photograph", marks=pytest.mark.slow), "figure_10_11_fields"]
)
def test_an_example_without_its_needs_names_the_extra_that_brings_them(script, tmp_path):
    # A module that is None cannot be imported: as where it is not installed.
    code = (
        "import runpy, sys; sys.modules['skimage'] = None; sys.argv = ['x', '--quick']; "
        f"runpy.run_path({str(ROOT / 'examples' / f'{script}.py')!r}, run_name='__main__')"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    (line,) = ended.stderr.splitlines()
    extra = re.search(r'pip install "\.\[(\w+)\]"', line)[1]
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert any(need.startswith("scikit-image") for need in extras[extra])
    assert any(extra in re.findall(r"\w+", need) for need in extras["all"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_poured_grains_are_looser_than_grains_left_in_place(printed):
    in_place, poured = (float(text) for text in re.findall(r"porosity (0\.\d+)", printed("pour_and_settle")))
    # Of 16 beds each of as many grains: void of 0.407 ± 0.005 against 0.257 ± 0.004, 28 spreads of a difference apart.
    assert poured > in_place


@pytest.mark.slow
def test_the_readmes_python_runs_as_it_stands(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    run("-c", code, folder=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"bed.usdc", "settled.h5"}


def commands():
    """Return the words of each command in the README's list, without `grainsdem`."""
    section = README.split("## From the command line")[1]
    lines = re.findall(r"^grainsdem (.*?)(?:\s*#.*)?$", section.split("```")[1], flags=re.MULTILINE)
    assert len(lines) == 14
    return [line.split() for line in lines]


@pytest.mark.slow
def test_the_readmes_commands_run_as_they_stand(tmp_path):
    for words in commands():
        run("-c", "from grainsdem.cli import main; main()", *words, folder=tmp_path)
    assert {"bed.h5", "bed.xml", "grains.csv", "settled.h5", "settled.png"} <= {p.name for p in tmp_path.iterdir()}


@pytest.mark.parametrize("words", commands(), ids=" ".join)
def test_the_readmes_commands_have_the_options_that_it_gives_them(words):
    command = get_command(app).get_command(None, words[0])
    options = {option for parameter in command.params for option in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= options


def test_the_demos_recipe_in_the_examples_is_the_one_in_the_package():
    example = ROOT / "examples" / "angular_sand.toml"
    assert example.read_bytes() == (ROOT / "grainsdem" / "angular_sand.toml").read_bytes()
