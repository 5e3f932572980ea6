from __future__ import annotations

import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

pytestmark = pytest.mark.example

ROOT = Path(__file__).parent.parent
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
README = (ROOT / "README.md").read_text(encoding="utf-8")


def run(*words, folder):
    return subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """A function: what an example prints when it runs quickly; each runs once."""

    @cache
    def run_quickly(name):
        return run(str(ROOT / "examples" / f"{name}.py"), "--quick", folder=tmp_path_factory.mktemp(name))

    return run_quickly


@pytest.mark.parametrize("script", [path.stem for path in SCRIPTS])
def test_every_example_runs_quickly_and_prints_something(script, printed):
    assert printed(script).strip()


def test_poured_grains_are_looser_than_grains_left_in_place(printed):
    in_place, poured = (float(text) for text in re.findall(r"porosity (0\.\d+)", printed("pour_and_settle")))
    assert poured > in_place + 0.03


def test_the_readmes_python_runs_as_it_stands(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    run("-c", code, folder=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"bed.usdc", "settled.h5"}


def test_the_readmes_commands_run_as_they_stand(tmp_path):
    section = README.split("## From the command line")[1]
    commands = re.findall(r"^grainsdem (.*?)(?:\s*#.*)?$", section.split("```")[1], flags=re.MULTILINE)
    assert len(commands) == 13
    for command in commands:
        run("-c", "from grainsdem.cli import main; main()", *command.split(), folder=tmp_path)
    assert {"bed.h5", "bed.xml", "grains.csv", "settled.h5", "settled.png"} <= {p.name for p in tmp_path.iterdir()}


def test_the_demos_recipe_in_the_examples_is_the_one_in_the_package():
    example = ROOT / "examples" / "ottawa_sand.toml"
    assert example.read_bytes() == (ROOT / "grainsdem" / "ottawa_sand.toml").read_bytes()
