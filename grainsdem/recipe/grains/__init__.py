"""``[grains]``: what the cells become, and the sizes that they are to have."""

from grainsdem.recipe.grains.axes import AxesTable
from grainsdem.recipe.grains.layers import Layers, LayerTable
from grainsdem.recipe.grains.shapes import ShapesTable, laid_out
from grainsdem.recipe.grains.sieves import SievesTable
from grainsdem.recipe.grains.sizes import SizesTable, sized
from grainsdem.recipe.grains.table import GrainsTable, ThroatsTable, shape, size_ratio

__all__ = [
    "AxesTable",
    "GrainsTable",
    "LayerTable",
    "Layers",
    "ShapesTable",
    "SievesTable",
    "SizesTable",
    "ThroatsTable",
    "laid_out",
    "shape",
    "size_ratio",
    "sized",
]
