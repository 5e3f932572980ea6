"""Seeds: where grains grow. One module a family of point processes."""

from grainsdem.points.check import check_seeds
from grainsdem.points.cluster import cluster_poisson
from grainsdem.points.files import read
from grainsdem.points.halton import halton
from grainsdem.points.poisson import poisson
from grainsdem.points.strauss import strauss, strauss_process

__all__ = ["check_seeds", "cluster_poisson", "halton", "poisson", "read", "strauss", "strauss_process"]
