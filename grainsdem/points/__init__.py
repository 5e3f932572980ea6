"""Seeds: where grains grow. One module a family of point processes."""

from grainsdem.points.check import check_seeds
from grainsdem.points.cluster import cluster_poisson
from grainsdem.points.fields import from_density, from_image, image_density, noise_field, pink_noise, read_density
from grainsdem.points.fields.grade import Grade
from grainsdem.points.files import read, scaled, write
from grainsdem.points.halton import halton
from grainsdem.points.patterns import clark_evans, describe, nearest_distances, pair_correlation, ripley_k
from grainsdem.points.poisson import poisson
from grainsdem.points.strauss import strauss, strauss_process

__all__ = [
    "Grade",
    "check_seeds",
    "clark_evans",
    "cluster_poisson",
    "describe",
    "from_density",
    "from_image",
    "halton",
    "image_density",
    "nearest_distances",
    "noise_field",
    "pair_correlation",
    "pink_noise",
    "poisson",
    "read",
    "read_density",
    "ripley_k",
    "scaled",
    "strauss",
    "strauss_process",
    "write",
]
