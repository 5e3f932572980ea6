from __future__ import annotations

import json

import pytest

from grainsdem import recipe
from grainsdem.errors import InputError
from grainsdem.recipe import make, run
from grainsdem.storage import load, load_history

BED = {"domain": {"side": 3e-3}, "seeds": {"count": 27}, "grains": {"porosity": 0.4}}


@pytest.mark.client
def test_a_recipes_experiments_are_run_and_written(tmp_path):
    tables = {
        **BED,
        "triaxial": {"strain": 0.01, "inertial_number": 0.1, "spheres": True},
        "collapse": {"max_time": 0.5, "seeds": 2},
        "output": {"formats": [], "figures": True},
    }
    result = run(make(**tables), tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told["triaxial"]["is_compressed"] in (True, False)
    assert told["triaxial"]["inertial_number"] == 0.1
    assert told["collapse"]["seeds"] == [0, 1]
    assert set(load_history(tmp_path / "collapse" / "1.h5")) >= {"time", "run_out"}
    assert load(tmp_path / "triaxial.h5").provenance[-1].count("triaxial")
    names = {path.name for path in result.files}
    assert {"triaxial.h5", "triaxial_history.h5", "triaxial.png", "0.h5", "1.h5"} <= names
    assert all(path.exists() for path in result.files)


@pytest.mark.unit
def test_a_recipe_without_experiments_tells_nothing_of_them():
    told = make(**BED).model_dump(mode="json")
    assert not {"triaxial", "shear", "collapse", "tilt"} & set(told)
    assert make(**{**BED, "tilt": {}}).model_dump()["tilt"]["rate"] == 0.01


@pytest.mark.unit
@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"triaxial": {"strain": 1.5}}, "triaxial.strain"),
        ({"triaxial": {"stress": 1.0}}, "unknown key; allowed are"),
        ({"shear": {"kind": "cube"}}, "shear.kind"),
        ({"shear": {"kind": "box", "inner_radius": 1e-3}}, "of a ring"),
        ({"shear": {"start": "place"}}, "always set apart"),
        ({"tilt": {"max_angle": 3.0}}, "tilt.max_angle"),
        ({"collapse": {"seeds": 3, "start": "place"}}, "several seeds"),
        ({"collapse": {"release": []}}, "collapse.release"),
    ],
)
def test_what_an_experiment_cannot_be_is_refused_by_its_key(table, words):
    with pytest.raises(InputError, match=words):
        make(**BED, **table)


@pytest.mark.unit
def test_each_table_calls_its_function_with_options_that_it_takes():
    from inspect import signature

    from grainsdem import dynamics

    tables = [
        recipe.experiments.TriaxialTable(),
        recipe.experiments.ShearTable(strain=1.0),
        recipe.experiments.ShearTable(kind="box", strain=0.1),
        recipe.experiments.CollapseTable(),
        recipe.experiments.TiltTable(),
    ]
    assert [table.call for table in tables] == ["triaxial", "ring_shear", "direct_shear", "collapse", "tilt"]
    for table in tables:
        allowed = signature(getattr(dynamics, table.call)).parameters
        assert set(table.options()) <= set(allowed)
        defaults = {name: allowed[name].default for name in table.options()}
        given = {name: value for name, value in table.options().items() if name not in ("strain", "displacement")}
        assert given == {name: defaults[name] for name in given}
