from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace

import fuzzing_commands
import h5py
import pytest
import typer
from typer.testing import CliRunner

import grainsdem
from grainsdem import __main__ as program
from grainsdem.atomic import check_place
from grainsdem.cli import app, guard
from grainsdem.errors import FileFormatError, WriteError
from grainsdem.storage.sink import created

pytestmark = pytest.mark.unit

WRITTEN = {
    f"{name} {one.name}": one
    for name, command in fuzzing_commands.commands().items()
    for one in fuzzing_commands.parameters(command)
    if one.written is not None
}


@pytest.fixture(scope="module")
def bed(fresh, tmp_path_factory):
    return grainsdem.save(fresh, tmp_path_factory.mktemp("bed") / "bed.h5")


def call(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.mark.parametrize("one", WRITTEN.values(), ids=WRITTEN)
def test_every_place_that_a_command_writes_refuses_another_suffix(one):
    if not one.written.check:
        return
    check = resolve_name(one.written.check)
    with pytest.raises(FileFormatError):
        check(Path("out.odd"))
    check(Path(f"out{fuzzing_commands.SUFFIXES[one.written.check]}"))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("section", "a.png", "--table", "a.xls"), "a.xls: a table is written as .csv; got '.xls'"),
        (("section", "a.png", "--profile", "a"), "a: a table is written as .csv; got 'no suffix'"),
        (("phases", "--figure", "a.jpg"), "a.jpg: "),
        (("measure", "--table", "nowhere/a.csv"), "nowhere/a.csv: cannot be written: No such file or directory"),
        (("measure", "--table", "a.csv", "--neighbors", "./a.csv"), "a.csv: is given as the place of two things"),
        (("settle", "s.h5", "--history", "."), ".: HDF5 files end in"),
        (("settle", "s.h5", "--history", "x" * 300 + ".h5"), "File name too long"),
        (("heal", "folder.h5"), "folder.h5: cannot be written: Is a directory"),
        (("planform", "file/out"), "file/out: cannot be made a folder: Not a directory"),
        (("tilt", "t.h5", "--forces", "f.xyz"), "f.xyz: contacts are written as"),
    ],
)  # fmt: skip
def test_a_place_that_cannot_be_written_is_refused_before_anything_is(words, told, bed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("folder.h5").mkdir()
    Path("file").touch()
    result = call(words[0], bed, *words[1:])
    assert result.exit_code == 2
    assert told in result.stderr
    assert result.stderr.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.h5"]


def test_a_folder_without_leave_to_write_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(WriteError, match=r"a\.h5: cannot be written: Permission denied"):
        check_place(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("generate", "a.h5", "--count", "0"), "error: invalid value for '--count'"),
        (("generate", "a.h5", "--cont", "1"), "error: no such option: --cont"),
        (("generate",), "error: missing argument 'output'"),
        (("grow",), "error: no such command 'grow'"),
    ],
)
def test_what_cannot_be_read_of_what_was_typed_is_one_line(words, told):
    result = call(*words)
    assert result.exit_code == 2
    assert result.stderr.lower().startswith(told.lower())
    assert result.stderr.endswith("--help tells what is allowed\n")
    assert result.stderr.count("\n") == 1


def ended(error):
    @guard.guarded
    def command():
        raise error

    return CliRunner().invoke(as_command(command), [])


def as_command(function):
    one = typer.Typer()
    one.command()(function)
    return one


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (
            OSError(28, "No space left on device"),
            2,
            "error: what is printed cannot be written: No space left on device\n",
        ),
        (OSError(13, "Permission denied", "a.csv"), 2, "error: a.csv: Permission denied\n"),
        (BrokenPipeError(32, "Broken pipe"), 141, ""),
        (MemoryError(), 2, "error: what was asked for does not fit in this machine's memory\n"),
        (KeyboardInterrupt(), 130, "interrupted\n"),
        (guard.TerminatedError(), 143, "terminated\n"),
    ],
)
def test_whatever_ends_a_command_is_told_in_one_line_with_a_code_of_its_own(error, code, told, monkeypatch):
    monkeypatch.setattr(guard, "silence", lambda: None)  # it is this process's own output
    result = ended(error)
    assert (result.exit_code, result.stderr) == (code, told)


def test_words_of_a_file_are_not_taken_for_markup(bed, tmp_path):
    odd = tmp_path / "[" / "bold]:smile:.h5"
    odd.parent.mkdir()
    odd.write_bytes(bed.read_bytes())
    for command in ("info", "validate", "measure"):
        result = call(command, odd)
        assert result.exit_code == 0, result.output
        assert "[/bold]:smile:.h5" in "".join(result.stdout.split("\n"))


def write_two(path):
    with created(path) as file:
        file["one"] = [1]
        signal.raise_signal(signal.SIGTERM)
        file["two"] = [2]


@pytest.mark.skipif(os.name == "nt", reason="signals are sent another way there")
def test_signals_are_heeded_by_a_command_and_end_the_program_beside_it(monkeypatch):
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with pytest.raises(guard.TerminatedError), guard.heeding():
            signal.raise_signal(signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)
    heard = []
    cli = SimpleNamespace(main=lambda: heard.append(signal.getsignal(signal.SIGINT)))
    monkeypatch.setitem(sys.modules, "grainsdem.cli", cli)
    monkeypatch.setitem(sys.modules, "grainsdem.cli.guard", guard)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        program.main()
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [signal.SIG_DFL]


def test_signals_wait_until_a_packing_is_whole(fresh, tmp_path):
    def press(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, press)
    try:
        with pytest.raises(KeyboardInterrupt):
            write_two(tmp_path / "a.h5")
        assert signal.getsignal(signal.SIGTERM) is press
    finally:
        signal.signal(signal.SIGTERM, before)
    with h5py.File(tmp_path / "a.h5") as file:
        assert set(file) == {"one", "two"}


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_command_ends_as_it_should_where_what_it_prints_goes_nowhere(bed, tmp_path):
    """Full devices, closed pipes and a word to end, in one process each that does what the program does."""
    found = {}
    for name in ("full", "closed"):
        read, write = os.pipe()
        os.close(read)
        child = os.fork()
        if not child:
            target = os.open("/dev/full", os.O_WRONLY) if name == "full" else write
            told = os.open(tmp_path / name, os.O_WRONLY | os.O_CREAT)
            os.dup2(target, 1)
            os.dup2(told, 2)
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
            guard.out.file, guard.err.file = sys.stdout, sys.stderr
            sys.argv = ["grainsdem", "info", str(bed)]
            try:
                grainsdem.cli.main()
            except SystemExit as end:
                sys.stderr.flush()
                os._exit(end.code)
            os._exit(99)
        os.close(write)
        found[name] = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), (tmp_path / name).read_text()
    assert found["full"] == (2, "error: what is printed cannot be written: No space left on device\n")
    assert found["closed"] == (141, "")


@pytest.mark.slow
def test_a_sample_of_odd_calls_ends_in_one_line(tmp_path):
    fuzzing_commands.prepare(tmp_path)
    cases = fuzzing_commands.sample(fuzzing_commands.command_cases(tmp_path), 120)
    cases += fuzzing_commands.sample(fuzzing_commands.recipe_cases(), 120)
    wrong = [(case, fault) for case, fault, _ in fuzzing_commands.tried(cases, tmp_path) if fault]
    assert wrong == []


@pytest.mark.slow
def test_every_command_has_a_right_call(tmp_path):
    fuzzing_commands.prepare(tmp_path)
    cases = [case for case in fuzzing_commands.command_cases(tmp_path) if case.value == "right"]
    assert {case.name for case in cases} == set(fuzzing_commands.commands()) - {"demo"}
    wrong = [(case, fault) for case, fault, _ in fuzzing_commands.tried(cases, tmp_path) if fault]
    assert wrong == []
