"""Kernels compiled in advance: what is missing, what is told, and that nothing hangs on it."""

import json
import logging
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from grainsdem import compiling
from grainsdem.cli import options
from grainsdem.geometry import ahead

EACH_ONCE = """
import collections, json, sys
from numba.core import event
from grainsdem.geometry import ahead

found = collections.Counter()

class Listener(event.Listener):
    def on_start(self, told):
        function = told.data["dispatcher"].py_func
        found[f"{function.__module__}.{function.__qualname__}"] += function.__module__.startswith("grainsdem.")

    def on_end(self, told):
        pass

event.register("numba:compile", Listener())
for step in ahead.STEPS:
    ahead.take(step)
print(json.dumps({name: count for name, count in found.items() if count > 1}))
"""


@pytest.fixture
def taken(monkeypatch, tmp_path):
    """Steps that were taken, in a machine of two processors that has compiled nothing."""
    steps = []

    def share(function, jobs, after):
        for number, job in enumerate(jobs):
            assert all(other < number for other in after[number])
            yield number, function(job)

    cache = SimpleNamespace(_integrate=SimpleNamespace(stats=SimpleNamespace(cache_path=tmp_path)))
    monkeypatch.setattr(ahead, "share", share)
    monkeypatch.setattr(ahead, "take", steps.append)
    monkeypatch.setattr(ahead, "integrals", cache)
    monkeypatch.setattr(ahead, "_done", set())
    monkeypatch.setattr(ahead, "n_processors", lambda: 2)
    return steps


@pytest.mark.unit
def test_every_step_is_taken_somehow_and_comes_behind_those_that_it_needs():
    assert sorted(compiling.TAKEN) == sorted(ahead.STEPS)
    order = list(ahead.STEPS)
    for step, (seconds, after) in ahead.STEPS.items():
        assert seconds > 0
        assert all(order.index(other) < order.index(step) for other in after)


@pytest.mark.unit
def test_a_step_is_taken_once_with_all_that_it_needs_and_only_where_it_is_missing(taken):
    assert ahead.missing("growing") == ["cutting", "starting", "growing"]
    told = []
    ahead.compile_kernels(ahead.missing("growing"), lambda done, n: told.append((done, n)))
    assert taken == ["cutting", "starting", "growing"]
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert ahead.missing("growing", "facets") == ["facets"]


@pytest.mark.unit
def test_a_function_has_its_kernels_compiled_once_and_says_so_where_it_logs(taken, caplog):
    caplog.set_level(logging.INFO, "grainsdem")
    for _ in range(2):
        ahead.compiled("facets")
    assert taken == ["facets"]
    assert [record.message for record in caplog.records] == [
        "compiling kernels, the first time on this machine: about 2 s"
    ]


@pytest.mark.unit
@pytest.mark.parametrize(("name", "value"), [("n_processors", 1), ("can_start", False)])
def test_nothing_is_compiled_apart_with_one_processor_or_inside_another_program(monkeypatch, taken, name, value):
    monkeypatch.setattr(ahead, name, lambda: value)
    ahead.compiled("facets")
    assert taken == []


@pytest.mark.unit
def test_without_compiling_there_is_nothing_to_compile(monkeypatch, taken):
    monkeypatch.setattr(ahead.numba.config, "DISABLE_JIT", 1)
    ahead.compiled("facets")
    assert taken == []


@pytest.mark.unit
@pytest.mark.usefixtures("taken")
@pytest.mark.parametrize("change", ["numba", "processor", "source"])
def test_another_numba_processor_or_source_has_all_compiled_again(monkeypatch, tmp_path, change):
    ahead.compile_kernels(["cutting"])
    assert not ahead.missing("cutting")
    if change == "numba":
        monkeypatch.setattr(ahead.numba, "__version__", "0.0")
    elif change == "processor":
        monkeypatch.setattr(ahead.llvm, "get_host_cpu_name", lambda: "another")
    else:
        (tmp_path / "geometry").mkdir()
        (tmp_path / "geometry" / "kernel.py").touch()
        monkeypatch.setattr(ahead, "__file__", str(tmp_path / "geometry" / "ahead.py"))
    assert ahead.missing("cutting") == ["cutting"]


@pytest.mark.unit
def test_the_time_told_is_that_of_two_processes_or_of_the_steps_that_wait_for_one_another(monkeypatch):
    monkeypatch.setattr(ahead, "n_processors", lambda: 2)
    steps = {"a": ahead.Step(4), "b": ahead.Step(4), "c": ahead.Step(2, ("a",)), "d": ahead.Step(6, ("c",))}
    monkeypatch.setattr(ahead, "STEPS", steps)
    assert ahead.seconds(["a", "b"]) == 5
    assert ahead.seconds(["a", "b", "c", "d"]) == 13
    assert ahead.seconds(["d"]) == 7
    assert ahead.seconds([]) == 0


@pytest.mark.unit
@pytest.mark.usefixtures("taken")
def test_the_user_is_told_once_and_on_the_error_stream_alone(capsys):
    options.prepare("cells", "contacts", quiet=False)
    out, err = capsys.readouterr()
    assert not out
    assert "compiling kernels, the first time on this machine: about" in err
    options.prepare("cells", "contacts", quiet=False)
    assert capsys.readouterr() == ("", "")


@pytest.mark.unit
def test_quiet_tells_nothing(taken, capsys):
    options.prepare("facets", quiet=True)
    assert taken == ["facets"]
    assert capsys.readouterr() == ("", "")


@pytest.mark.unit
@pytest.mark.usefixtures("taken")
@pytest.mark.parametrize("call", [lambda: options.prepare("facets", quiet=True), lambda: ahead.compiled("facets")])
def test_work_goes_on_where_kernels_cannot_be_compiled_in_advance(monkeypatch, call):
    def fail(step):
        raise OSError(step)

    monkeypatch.setattr(ahead, "take", fail)
    call()
    assert ahead.missing("facets") == ["facets"]


@pytest.mark.slow
def test_each_function_is_compiled_once_by_all_steps_together(tmp_path):
    # A function that is compiled apart for other types than its kernel has would be compiled twice.
    made = subprocess.run(
        [sys.executable, "-c", EACH_ONCE],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(made.stdout) == {}
