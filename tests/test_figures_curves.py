from __future__ import annotations

import numpy as np
import pytest
from matplotlib.image import imread

from grainsdem.dynamics.experiments import registry
from grainsdem.errors import FileFormatError, InputError, ShapeError
from grainsdem.figures.curves import Panel, curve_figure

pytestmark = pytest.mark.unit


def history(**series):
    """Return series of ten samples, of which the first four are of the first stage."""
    stage = np.r_[np.zeros(4), np.ones(6)]
    return {"time": np.arange(10.0), "stage": stage, **{name: np.asarray(row, float) for name, row in series.items()}}


TRIAXIAL = history(
    axial_strain=np.linspace(-0.1, 0.4, 10),
    volumetric_strain=np.zeros(10),
    axial_stress=np.full(10, 3.0),
    lateral_stress=np.ones(10),
    axial_stress_contacts=np.full(10, 3.0),
    lateral_stress_contacts=np.ones(10),
)
SHEAR = history(
    shear_strain=np.linspace(0, 1, 10),
    volumetric_strain=np.zeros(10),
    friction=np.full(10, 0.5),
    normal_stress=np.full(10, 2.0),
    shear_stress=np.ones(10),
    normal_stress_contacts=np.full(10, 4.0),
    shear_stress_contacts=np.ones(10),
)
VELOCITIES = {"height": np.array([0.1, 0.9]), "velocity": np.array([0.0, 1.0])}
SURFACE = {"distance": np.array([0.0, 1.0]), "height": np.array([1.0, 0.0])}


def test_a_stress_ratio_of_three_is_a_friction_angle_of_thirty_degrees():
    angles, dilation = registry.find("triaxial").drawn(TRIAXIAL, {})
    for name in ("walls", "contacts"):
        np.testing.assert_allclose(angles.curves[name][1], 30.0)
    assert len(dilation.curves[""][0]) == 6


def test_friction_of_lid_and_contacts_are_drawn_each_from_its_own_stresses():
    ratios, _, profile = registry.find("ring_shear").drawn(SHEAR, VELOCITIES)
    assert profile.points[""] == (VELOCITIES["velocity"], VELOCITIES["height"])
    np.testing.assert_allclose(ratios.curves["lid"][1], 0.5)
    np.testing.assert_allclose(ratios.curves["contacts"][1], 0.25)


@pytest.mark.parametrize(
    ("name", "series", "profile"),
    [
        ("triaxial", TRIAXIAL, {}),
        ("ring_shear", SHEAR, VELOCITIES),
        ("collapse", history(run_out=np.arange(10), height=np.arange(10)), SURFACE),
        ("tilt", history(angle=np.linspace(0, 1, 10), gone_fraction=np.zeros(10)), {}),
        (
            "tap",
            history(porosity=np.linspace(0.5, 0.4, 10)),
            {"taps": np.arange(2.0), "porosity": np.array([0.5, 0.4])},
        ),
    ],
)
def test_a_figure_has_as_many_panels_as_its_experiment_says(name, series, profile, tmp_path):
    panels = registry.find(name).drawn(series, profile)
    path = curve_figure(panels, tmp_path / "curves.png")
    height, width = imread(path).shape[:2]
    assert width == 832
    assert height == pytest.approx(130 * (0.6 + 2.8 * len(panels)), abs=1)


def test_a_run_that_never_came_to_its_second_stage_has_no_curves():
    never = {**TRIAXIAL, "stage": np.zeros(10)}
    assert list(registry.find("triaxial").drawn(never, {})) == []


def test_bands_and_points_are_drawn_beside_their_curves(tmp_path):
    x = np.linspace(0, 1, 5)
    plain = curve_figure([Panel("x", "y", {"one": (x, x)})], tmp_path / "plain.png")
    banded = curve_figure(
        [Panel("x", "y", {"one": (x, x, 0.1 + x)}, {"one": (x, x, 0.1 + x)})], tmp_path / "banded.png"
    )
    assert (imread(plain) != imread(banded)).any()
    assert plain.read_bytes() == curve_figure([Panel("x", "y", {"one": (x, x)})], tmp_path / "again.png").read_bytes()


def test_what_cannot_be_drawn_is_refused(tmp_path):
    with pytest.raises(InputError, match="needs a panel"):
        curve_figure([], tmp_path / "a.png")
    with pytest.raises(ShapeError, match="'one' must be"):
        curve_figure([Panel("x", "y", {"one": ([0.0, 1.0], [0.0])})], tmp_path / "a.png")
    with pytest.raises(FileFormatError, match=r"\.png"):
        curve_figure([Panel("x", "y", {})], tmp_path / "a.pdf")
    assert list(tmp_path.iterdir()) == []
