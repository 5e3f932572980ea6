"""Kernels compiled in advance: what is missing, what is told, and that nothing hangs on it."""

from itertools import chain
from types import SimpleNamespace

import pytest

from grainsdem import compiling
from grainsdem.cli import options

pytestmark = pytest.mark.unit


@pytest.fixture
def taken(monkeypatch, tmp_path):
    """Steps that were taken, in a machine that has compiled nothing."""
    steps = []

    def share(function, jobs):
        for number, job in enumerate(jobs):
            yield number, function(job)

    monkeypatch.setattr(compiling, "share", share)
    monkeypatch.setattr(compiling, "STEPS", {step: lambda step=step: steps.append(step) for step in compiling.STEPS})
    monkeypatch.setattr(
        compiling, "integrals", SimpleNamespace(_integrate=SimpleNamespace(stats=SimpleNamespace(cache_path=tmp_path)))
    )
    return steps


def test_every_step_is_in_one_chain_and_has_a_time():
    assert sorted(chain.from_iterable(compiling.CHAINS)) == sorted(compiling.STEPS) == sorted(compiling.SECONDS)


def test_a_step_is_taken_once_and_only_where_it_is_missing(taken):
    assert compiling.missing(["cells", "proof"]) == ["cells", "proof"]
    told = []
    compiling.compile_kernels(["cells", "proof"], lambda done, n: told.append((done, n)))
    assert sorted(taken) == ["cells", "proof"]
    assert told[-1] == (2, 2)
    assert compiling.missing(["cells", "walls", "proof"]) == ["walls"]
    compiling.compile_kernels(["cells", "walls"])
    assert sorted(taken) == ["cells", "proof", "walls"]


@pytest.mark.usefixtures("taken")
@pytest.mark.parametrize("change", ["numba", "processor", "source"])
def test_another_numba_processor_or_source_has_all_compiled_again(monkeypatch, tmp_path, change):
    compiling.compile_kernels(["cells"])
    assert not compiling.missing(["cells"])
    if change == "numba":
        monkeypatch.setattr(compiling.numba, "__version__", "0.0")
    elif change == "processor":
        monkeypatch.setattr(compiling.llvm, "get_host_cpu_name", lambda: "another")
    else:
        (tmp_path / "geometry").mkdir()
        (tmp_path / "geometry" / "kernel.py").touch()
        monkeypatch.setattr(compiling, "__file__", str(tmp_path / "compiling.py"))
    assert compiling.missing(["cells"]) == ["cells"]


@pytest.mark.usefixtures("taken")
def test_the_user_is_told_once_and_on_the_error_stream_alone(capsys):
    options.prepare("cells", "contacts", quiet=False)
    out, err = capsys.readouterr()
    assert not out
    assert "compiling kernels, the first time on this machine: about" in err
    options.prepare("cells", "contacts", quiet=False)
    assert capsys.readouterr() == ("", "")


def test_quiet_tells_nothing(taken, capsys):
    options.prepare("cells", quiet=True)
    assert taken == ["cells"]
    assert capsys.readouterr() == ("", "")


@pytest.mark.usefixtures("taken")
def test_a_command_goes_on_where_kernels_cannot_be_compiled_in_advance(monkeypatch):
    def fail():
        raise OSError

    monkeypatch.setitem(compiling.STEPS, "cells", fail)
    options.prepare("cells", quiet=True)
    assert compiling.missing(["cells"]) == ["cells"]
