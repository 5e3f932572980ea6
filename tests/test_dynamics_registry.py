"""What follows from the options of an experiment: signature, help, command, table, schema, page, ensembles."""

from __future__ import annotations

import inspect
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from loading import grow, grow_planar
from typer.main import get_command
from typer.testing import CliRunner

import grainsdem
from grainsdem import dynamics, storage
from grainsdem.cli import app
from grainsdem.described import description
from grainsdem.dynamics.experiments import registry
from grainsdem.errors import InputError, MissingPackageError
from grainsdem.recipe.experiments import experiment_tables
from grainsdem.recipe.motion import SettleTable
from grainsdem.recipe.tables import recipe_model

DOCS = Path(__file__).parent.parent / "docs"
PAGE = (DOCS / "your_own_experiment.md").read_text(encoding="utf-8")
CODE = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
ENTRY = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)[1]
EVERY = pytest.mark.parametrize("name", list(registry.BUILT_IN))


@pytest.mark.unit
@EVERY
def test_all_that_offers_an_experiment_has_its_options_and_defaults(name):
    found = registry.find(name)
    options = {told.name: told.default for told in found.told()}
    signature = inspect.signature(getattr(dynamics, name)).parameters
    assert {key: signature[key].default for key in options} == options
    assert set(signature) == {"packing", *options, *found.notes}
    assert found.notes.items() >= registry.NOTES.items()
    table = experiment_tables()[name]().options()
    assert table == options
    command = get_command(app).get_command(None, name.replace("_", "-"))
    defaults = {parameter.name: parameter.default for parameter in command.params}
    assert {key: defaults[key] for key in options} == options
    assert list(found.schema()["properties"]) == list(options)


@pytest.mark.unit
@EVERY
def test_every_option_has_a_sentence_wherever_it_is_told(name):
    found = registry.find(name)
    command = get_command(app).get_command(None, name)
    help_of = {parameter.name: parameter.help for parameter in command.params if hasattr(parameter, "help")}
    for told in found.told():
        sentence = told.help.removesuffix(".")
        assert told.help.endswith(".")
        assert sentence in " ".join(found.function.__doc__.split())
        assert sentence in help_of[told.name]
        assert told.help == found.schema()["properties"][told.name]["description"]


@pytest.mark.unit
@EVERY
def test_every_experiment_says_what_it_will_take_and_keeps_to_max_hours(name, caplog, tmp_path, tmp_path_factory):
    function, needs = getattr(dynamics, name), {}
    if name == "own_part":
        needs["duration"], needs["model"] = 1.0, tmp_path_factory.mktemp("part") / "ball.xml"
        needs["model"].write_text(
            '<mujoco><worldbody><body pos="2e-3 2e-3 0.1"><freejoint/><geom size="1e-3"/></body></worldbody></mujoco>'
        )
    with (
        caplog.at_level("INFO", logger="grainsdem"),
        pytest.raises(InputError, match=r"takes too long: 120 grains: .*max_hours is 1e-09"),
    ):
        function(grow(120), rng=1, max_hours=1e-9, history_path=tmp_path / "history.h5", **needs)
    assert list(tmp_path.iterdir()) == []
    assert not caplog.messages


@pytest.mark.client
def test_an_experiment_tells_its_estimate_and_is_refused_where_its_time_limit_makes_it_too_long(caplog):
    with caplog.at_level("INFO", logger="grainsdem.dynamics.budget"):
        dynamics.collapse(grow_planar(9), rng=1, max_time=0.3)
    assert [record.getMessage()[:27] for record in caplog.records if record.levelname == "INFO"] == [
        "9 grains: about 0.26 GB and"
    ]
    with pytest.raises(InputError, match=r"takes too long: 9 grains.* days .*max_hours is 24"):
        dynamics.collapse(grow_planar(9), rng=1, max_time=1e9)


@pytest.mark.unit
def test_a_recipe_has_a_table_for_each_experiment_in_the_order_in_which_they_are_run():
    assert [name for name in recipe_model().model_fields if name in registry.names()] == registry.names()


@pytest.mark.unit
def test_settling_has_its_options_wherever_it_is_offered_and_pours_but_in_python():
    found = description(dynamics.settle)
    options = {told.name: told.default for told in found.told()}
    signature = inspect.signature(dynamics.settle).parameters
    assert set(signature) == {"packing", *options, *found.notes}
    in_python = {key: signature[key].default for key in options}
    assert in_python.pop("start") == "place"
    assert options == {"start": "pour", **in_python}
    table = SettleTable().model_dump()
    assert table == {**options, "max_hours": signature["max_hours"].default, "overlap": 1e-3}
    command = get_command(app).get_command(None, "settle")
    assert {p.name: p.default for p in command.params}.items() >= options.items()
    help_of = {parameter.name: parameter.help for parameter in command.params if hasattr(parameter, "help")}
    told = json.loads(CliRunner().invoke(app, ["experiments", "settle", "--json"]).output)["settle"]["properties"]
    for option in found.told():
        sentence = option.help.removesuffix(".")
        assert sentence in " ".join(dynamics.settle.__doc__.split())
        assert sentence in help_of[option.name]
        assert told[option.name]["description"] == option.help


@pytest.mark.unit
def test_the_page_of_options_is_what_the_experiments_say():
    told = [description(dynamics.settle), *map(registry.find, registry.BUILT_IN)]
    pages = "\n".join(found.page() for found in told)
    assert (DOCS / "experiments.md").read_text(encoding="utf-8").endswith(f"\n\n{pages}"), (
        "write it anew: (sed '/^## /,$d' docs/experiments.md; grainsdem experiments --markdown) > page"
    )


@pytest.mark.unit
def test_what_is_no_experiment_is_refused_with_the_names_of_those_there_are():
    with pytest.raises(InputError, match="no experiment 'triax'; there are compact, tap, triaxial, ring_shear"):
        registry.find("triax")
    with pytest.raises(InputError, match="'grow' is no experiment"):
        registry.of(grow)
    assert registry.of(dynamics.tilt) is registry.find("tilt")
    assert registry.find("ring-shear").function is dynamics.ring_shear


@pytest.mark.unit
def test_an_entry_point_that_cannot_be_loaded_is_named(monkeypatch):
    from importlib.metadata import EntryPoint

    broken = EntryPoint("sift", "no_such_module:sift", registry.GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda **_: [broken])
    assert registry.names()[-1] == "sift"
    with pytest.raises(MissingPackageError, match="'sift', no_such_module:sift, cannot be loaded: No module"):
        registry.find("sift")
    assert CliRunner().invoke(app, ["sift"]).exit_code == 2


@pytest.mark.unit
def test_experiments_are_listed_and_each_tells_its_options():
    listed = CliRunner().invoke(app, ["experiments"]).output
    assert all(name in listed for name in registry.BUILT_IN)
    told = " ".join(CliRunner().invoke(app, ["experiments", "tilt"]).output.replace("│", " ").split())
    assert "[rad; above 0; default 0.01]" in told
    schema = json.loads(CliRunner().invoke(app, ["experiments", "tilt", "--json"]).output)["tilt"]
    assert schema["properties"]["rate"]["exclusiveMinimum"] == 0
    refused = CliRunner().invoke(app, ["experiments", "tlit"])
    assert refused.exit_code == 2
    assert "there are compact" in " ".join(refused.output.split())


@pytest.mark.unit
def test_help_has_its_sections_in_order_however_little_a_docstring_says(monkeypatch):
    monkeypatch.setattr(registry, "_found", {})
    made = {}
    exec(compile(CODE, "creep.py", "exec", dont_inherit=True), made)  # noqa: S102  (the page's own code)
    for function in (made["creep"], dynamics.tilt):
        text = function.__doc__
        places = [text.index(f"\n\n{name}\n---") for name in ("Parameters", "Raises")]
        assert 0 < places[0] < text.index("friction : float\n") < places[1] < text.index("UnstableError\n")
        assert function.__doc__.startswith(function.__doc__.partition("\n")[0])
        assert text.count("packing : Packing") == 1


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder that the page's package lies in, with the metadata that an installer writes, and a bed."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "creep.py").write_text(CODE, encoding="utf-8")
    info = folder / "creep-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: creep\nVersion: 1.0\n", encoding="utf-8")
    ((group, points),) = tomllib.loads(ENTRY)["project"]["entry-points"].items()
    lines = [f"[{group}]", *(f"{name} = {value}" for name, value in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    storage.save(grow(12), folder / "bed.h5")
    return folder


def command(folder, *words, code=0):
    """Run a command with the folder's packages."""
    made = subprocess.run(
        [sys.executable, "-c", "from grainsdem.cli import main; main()", *map(str, words)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(Path(grainsdem.__file__).parents[1])])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == code, made.stderr
    return made


@pytest.mark.unit
def test_the_pages_experiment_is_one_of_at_most_sixty_lines():
    assert len(CODE.splitlines()) <= 60


@pytest.mark.slow
@pytest.mark.client
def test_an_experiment_of_another_package_is_a_command_with_history_and_figure(installed):
    words = ["--angle", 0.3, "--duration", 1, "--spheres", "--history", "creep_history.h5", "--figure", "creep.png"]
    told = json.loads(command(installed, "creep", "bed.h5", "crept.h5", *words, "--json").stdout)
    assert told["displacement"] > 0
    history = storage.load_history(installed / "creep_history.h5")
    assert history["displacement"][-1] == pytest.approx(told["displacement"], rel=1e-12)
    assert (installed / "creep.png").stat().st_size > 1000
    last = json.loads(storage.load(installed / "crept.h5").provenance[-1])
    assert (last["step"], last["angle"], last["duration"], last["spheres"]) == ("creep", 0.3, 1.0, True)
    refused = command(installed, "creep", "bed.h5", "never.h5", "--angle", 2, code=2)
    assert "angle: input should be less than 1; got 2.0" in refused.stderr
    assert not (installed / "never.h5").exists()


@pytest.mark.slow
@pytest.mark.client
def test_an_experiment_of_another_package_is_a_recipes_table_and_an_ensemble(installed):
    recipe = """
        [domain]
        side = 3e-3
        [seeds]
        count = 12
        [grains]
        porosity = 0.4
        keep = "all"
        [creep]
        duration = 1.0
        spheres = true
        [output]
        formats = []
        figures = false
    """
    (installed / "bed.toml").write_text(recipe, encoding="utf-8")
    command(installed, "run", "bed.toml", "--folder", "made", "--quiet")
    assert json.loads((installed / "made" / "summary.json").read_text())["creep"]["displacement"] > 0
    words = ["creep", "bed.h5", "duration=1.0", "spheres=true", "--seeds", 2, "--json"]
    assert json.loads(command(installed, "ensemble", *words).stdout)["seeds"] == [0, 1]
    (installed / "bed.toml").write_text(recipe.replace("duration = 1.0", "duration = -1.0"), encoding="utf-8")
    refused = command(installed, "run", "bed.toml", "--folder", "never", code=2)
    assert "creep.duration: input should be greater than 0; got -1.0" in refused.stderr
