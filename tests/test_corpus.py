"""Every small file that a reader ever failed at gives its line, or is read."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from fuzzing import outcome
from fuzzing_files import READ

from grainsdem.errors import GrainsDEMError

CORPUS = Path(__file__).parent / "corpus"
CASES = tomllib.loads((CORPUS / "index.toml").read_text(encoding="utf-8"))["case"]
KEPT = {"index.toml", "make.py"}


@pytest.mark.unit
def test_every_file_of_the_corpus_has_its_line():
    assert {path.name for path in CORPUS.iterdir() if path.is_file()} == {case["file"] for case in CASES} | KEPT


@pytest.mark.unit
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['file']}-{case['reader']}")
def test_a_file_at_which_a_reader_failed_gives_its_line_or_is_read(case):
    path, said = CORPUS / case["file"], []

    def read(path):
        try:
            READ[case["reader"]](path)
        except GrainsDEMError as error:
            said.append(str(error))
            raise

    assert outcome(read, {"path": path}) is None
    lines = [re.sub(r"^\S*/", "", line) for line in said]
    assert (lines[0] if lines else "").startswith(case.get("line", ""))
    assert bool(lines) == ("line" in case)


@pytest.mark.slow
@pytest.mark.unit
def test_changed_files_are_read_or_refused_in_one_line(tmp_path):
    env = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    command = [sys.executable, Path(__file__).with_name("fuzzing_files.py"), "--minutes", "1", "--kept", tmp_path]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=env)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "\n| damaged HDF5 | " in ended.stdout
