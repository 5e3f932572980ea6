"""A grey image of a planform, as a camera straight above the bed would take it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.raster.above import shadows, sky
from grainsdem.geometry.raster.copies import turned_normals

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.measures.planform.views import Planform
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

LIGHT = (-1.0, 1.0, 1.5)
"""Direction to the light: from the upper left, as pictures of relief are lit."""

REACH = 3.0
"""How far grains hide the sky from one another, in mean diameters."""


@gated
def photograph(
    view: Planform,
    packing: Packing,
    *,
    light: ArrayLike = LIGHT,
    ambient: float = 0.4,
    brightness: float = 0.6,
    variety: float = 0.15,
    blur: float = 0.0,
    noise: float = 0.0,
    rng: np.random.Generator | int | None = None,
) -> Floats:
    """Return a grey image of a planform: 0 black, 1 white.

    Parameters
    ----------
    view : Planform
        What is seen of the packing.
    packing : Packing
        The same packing.
    light : array_like, shape (3,)
        Direction to the light, above the horizon; of any length.
    ambient : float
        Share of the light that comes from the whole sky, in [0, 1]; it darkens what lies between grains. With 1 there
        are no shadows.
    brightness : float
        Grey of a level face of mean reflectance in full light, above 0.
    variety : float
        Standard deviation of the logarithm of the grains' reflectance: how much lighter some are than others.
    blur : float
        Standard deviation of the Gaussian that a point is spread to [pixels].
    noise : float
        Standard deviation of the grey that is added to each pixel, after the blur.
    rng : Generator, int or None
        Source of reflectances and noise.

    Returns
    -------
    ndarray, shape (ny, nx)
        Within [0, 1]. The same view, options and seed give the same bytes on the same processor.

    Raises
    ------
    InputError
        If the packing is another than the view's, the light is not above the horizon, or a number is out of its range.

    Notes
    -----
    Grey is ρ (k s + (1 - k) (n · l) e / l_z), ρ the grain's reflectance (Lambert), k the ambient share, s the share of
    the sky that the pixel sees above what is around it, n the normal of the face, l the unit vector to the light, and e
    one in its light, zero in the shadow of what is around it. The floor is drawn as a level face of mean reflectance.
    """
    towards = _checked(light, ambient=ambient, brightness=brightness, variety=variety, blur=blur, noise=noise)
    if view.labels.max(initial=0) > len(packing) or view.faces.max(initial=0) >= max(packing.grains.n_faces, 1):
        raise InputError(
            f"the view must be of this packing of {len(packing)} grains; it shows grain {view.labels.max() - 1}"
        )
    generator = np.random.default_rng(rng)
    heights = np.where(view.labels > 0, view.heights, view.floor)
    pixel, wraps = float(view.pixel.mean()), (bool(view.periodic[0]), bool(view.periodic[1]))
    normals = np.vstack([turned_normals(packing, face_planes(packing.grains).normals), [[0.0, 0.0, 1.0]]])
    # The last row is the floor's, which -1 finds.
    direct = np.maximum(normals @ towards, 0.0)[view.faces] / towards[2]
    if ambient < 1:
        direct[shadows(heights, pixel, towards, wraps=wraps)] = 0.0
    size = float(grain_diameters(packing).mean()) if len(packing) else pixel
    open_sky = sky(heights, pixel, REACH * size, wraps=wraps) if ambient > 0 else np.ones_like(heights)
    reflectance = np.append(1.0, np.exp(variety * generator.standard_normal(len(packing))))
    grey = brightness * reflectance[view.labels] * (ambient * open_sky + (1 - ambient) * direct)
    if blur > 0:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (scipy.ndimage costs a tenth of a second)

        modes: list[Literal["wrap", "nearest"]] = ["wrap" if wrap else "nearest" for wrap in wraps[::-1]]
        grey = gaussian_filter(grey, blur, mode=modes)
    if noise > 0:
        grey = grey + noise * generator.standard_normal(grey.shape)
    return np.asarray(np.clip(grey, 0.0, 1.0))


def _checked(light: ArrayLike, **numbers: float) -> Floats:
    """Return the unit vector to the light, or raise where an option is out of its range."""
    towards = np.asarray(light, dtype=np.float64)
    if towards.shape != (3,) or not np.isfinite(towards).all() or towards[2] <= 0:
        raise InputError(f"light must be a direction (x, y, z) above the horizon, z > 0; got {towards.tolist()}")
    for name, value in numbers.items():
        most = 1.0 if name == "ambient" else np.inf
        if not (0 <= value <= most and np.isfinite(value)) or (name == "brightness" and value == 0):
            allowed = {"ambient": "in [0, 1]", "brightness": "positive and finite"}.get(name, "zero or more and finite")
            raise InputError(f"{name} must be {allowed}; got {value}")
    return np.asarray(towards / np.linalg.norm(towards))
