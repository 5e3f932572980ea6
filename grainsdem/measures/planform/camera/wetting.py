"""Water on grains: they are darker, and they shine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

INDEX = 1.333
"""Refractive index of water."""

MIRRORED = ((INDEX - 1) / (INDEX + 1)) ** 2
"""Share of the light that water mirrors straight back, by Fresnel's equations."""


def wet_reflectance(dry: ArrayLike) -> Floats:
    """Return the reflectance of surfaces under a film of water from the dry one, both in [0, 1].

    Notes
    -----
    Light that the surface scatters leaves the film within a cone only: a share 1 / n² of it, and the rest is scattered
    once more. With R what the film mirrors, a becomes (1 - R) a / (n² (1 - a) + a): dark grains get
    darker by nearly n², white ones stay white, and colours deepen.

    References
    ----------
    Ångström, A. (1925). The albedo of various surfaces of ground. Geografiska Annaler 7, 323-342.
    Lekner, J. and Dorf, M. C. (1988). Why some things are darker when wet. Applied Optics 27, 1278-1280.
    """
    a = np.asarray(dry, dtype=np.float64)
    return np.asarray((1 - MIRRORED) * a / (INDEX**2 * (1 - a) + a))


def highlights(normals: Floats, towards: Floats, gloss: float) -> Floats:
    """Return what a film mirrors of a beam into a camera straight above, over what a white face would scatter.

    Parameters
    ----------
    normals : ndarray, shape (..., 3)
        Unit normals of the faces.
    towards : ndarray, shape (3,) or (..., 3)
        Unit vectors to the light.
    gloss : float
        Exponent: the larger, the smaller and brighter are highlights.

    Notes
    -----
    Blinn and Phong's lobe (m + 8) / 8 F (n · h)^m, h the unit vector halfway between the light and the camera and F
    what water mirrors there, by Schlick's approximation of Fresnel's equations.

    References
    ----------
    Blinn, J. F. (1977). Models of light reflection for computer synthesized pictures. SIGGRAPH '77, 192-198.
    Schlick, C. (1994). An inexpensive BRDF model for physically-based rendering. Computer Graphics Forum 13, 233-246.
    """
    halfway = towards + np.array([0.0, 0.0, 1.0])
    halfway = halfway / np.linalg.norm(halfway, axis=-1, keepdims=True)
    mirrored = MIRRORED + (1 - MIRRORED) * (1 - halfway[..., 2]) ** 5
    along = np.maximum(np.einsum("...k,...k->...", normals, halfway), 0.0)
    return np.asarray((gloss + 8) / 8 * mirrored * along**gloss)
