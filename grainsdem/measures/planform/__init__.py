"""The planform: a bed seen from above, as images of known truth to test the measurement of grains on."""

from grainsdem.measures.planform.camera.lens import CameraLens
from grainsdem.measures.planform.counting import pebble_count, size_percentiles
from grainsdem.measures.planform.files import write_planform
from grainsdem.measures.planform.photographs import photograph
from grainsdem.measures.planform.truth import planform_bias, planform_table
from grainsdem.measures.planform.views import Planform, planform

__all__ = [
    "CameraLens",
    "Planform",
    "pebble_count",
    "photograph",
    "planform",
    "planform_bias",
    "planform_table",
    "size_percentiles",
    "write_planform",
]
