from . import figures, points, recipe
from .dynamics import Settled, SettleReport, settle
from .errors import (
    FileFormatError,
    GrainsDEMError,
    InputError,
    MissingFileError,
    MissingPackageError,
    ShapeError,
    UnstableError,
    ValidationError,
    WriteError,
)
from .geometry.integrals import centroids, face_planes, inertia_tensors, integrate, surface_areas, volumes
from .geometry.rotations import world_vertices
from .measures import core_box, diameters, masses, percentiles, porosity, sphericities, summary, table
from .model import CellLinks, Check, ContactGraph, Domain, Packing, Polyhedra, Report, Tessellation
from .packing import carve, contacts, rescale, shrink, shuffle
from .storage import load, load_history, save
from .tessellation import relax, tessellate
from .validation import validate

__version__: str

__all__ = [
    "CellLinks",
    "Check",
    "ContactGraph",
    "Domain",
    "FileFormatError",
    "GrainsDEMError",
    "InputError",
    "MissingFileError",
    "MissingPackageError",
    "Packing",
    "Polyhedra",
    "Report",
    "SettleReport",
    "Settled",
    "ShapeError",
    "Tessellation",
    "UnstableError",
    "ValidationError",
    "WriteError",
    "carve",
    "centroids",
    "contacts",
    "core_box",
    "diameters",
    "face_planes",
    "figures",
    "inertia_tensors",
    "integrate",
    "load",
    "load_history",
    "masses",
    "percentiles",
    "points",
    "porosity",
    "recipe",
    "relax",
    "rescale",
    "save",
    "settle",
    "shrink",
    "shuffle",
    "sphericities",
    "summary",
    "surface_areas",
    "table",
    "tessellate",
    "validate",
    "volumes",
    "world_vertices",
]
