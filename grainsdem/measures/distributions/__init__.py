"""Distributions of size: percentiles, statistics in φ units, and fits by maximum likelihood."""

from grainsdem.measures.distributions.fits import FAMILIES, SizeFit, fit_sizes
from grainsdem.measures.distributions.hyperbolic import LogHyperbolic
from grainsdem.measures.distributions.normal import LogNormal, Normal
from grainsdem.measures.distributions.sheets.reading import read_sieves
from grainsdem.measures.distributions.sheets.sheet import SieveSheet
from grainsdem.measures.distributions.sieves import fit_sieves, sieve_statistics
from grainsdem.measures.distributions.statistics import (
    PhiStatistics,
    SizeStatistics,
    size_distribution,
    size_statistics,
    to_phi,
)

__all__ = [
    "FAMILIES",
    "LogHyperbolic",
    "LogNormal",
    "Normal",
    "PhiStatistics",
    "SieveSheet",
    "SizeFit",
    "SizeStatistics",
    "fit_sieves",
    "fit_sizes",
    "read_sieves",
    "sieve_statistics",
    "size_distribution",
    "size_statistics",
    "to_phi",
]
