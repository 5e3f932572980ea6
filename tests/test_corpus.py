"""Every small file that a reader ever failed at gives its line, or is read."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from fuzzing import outcome
from fuzzing_files import READ, formats, tell

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
def test_changed_files_are_read_or_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("grainsdem.apart.PATIENCE", 2.0)
    monkeypatch.chdir(tmp_path)
    every = formats(tmp_path)
    found = [
        fault
        for name, kind in every.items()
        for fault in tell(name, kind, tmp_path, tmp_path / "kept", seed=0, minutes=1 / len(every))[1]
    ]
    assert not found
