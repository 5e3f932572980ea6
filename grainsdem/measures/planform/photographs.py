"""An image of a planform, as a camera straight above the bed would take it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator

from grainsdem.described import described, description
from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.raster.above import sky
from grainsdem.geometry.raster.copies import turned_normals
from grainsdem.measures.planform.camera.colors import drawn_colors, mixture
from grainsdem.measures.planform.camera.lens import CameraLens, vignetting
from grainsdem.measures.planform.camera.lighting import CastShadow, beam, passed, unevenness
from grainsdem.measures.planform.camera.textures import texture as drawn_texture
from grainsdem.measures.planform.camera.wetting import highlights, wet_reflectance
from grainsdem.measures.planform.views import Planform
from grainsdem.model import Packing
from grainsdem.options import checked, option

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LIGHT = (-1.0, 1.0, 1.5)
"""Direction to the light: from the upper left, as pictures of relief are lit."""

REACH = 3.0
"""How far grains hide the sky from one another, in mean diameters."""


def _vector(given: Any) -> Any:
    """Return numbers of any array as a tuple."""
    return (
        tuple(given.tolist()) if isinstance(given, np.ndarray) else tuple(given) if isinstance(given, list) else given
    )


def _above_horizon(light: tuple[float, float, float]) -> tuple[float, float, float]:
    if light[2] <= 0:
        raise ValueError("must be a direction (x, y, z) above the horizon, z > 0")
    return light


def _gentle(gradient: tuple[float, float]) -> tuple[float, float]:
    if abs(gradient[0]) + abs(gradient[1]) > 2:
        raise ValueError("no light may be below zero: the sizes of both numbers must add up to 2 at most")
    return gradient


def _unfolded(lens: tuple[float, float]) -> tuple[float, float]:
    CameraLens(*lens, (1, 1))
    return lens


Direction = Annotated[tuple[float, float, float], BeforeValidator(_vector), AfterValidator(_above_horizon)]
Gradient = Annotated[tuple[float, float], BeforeValidator(_vector), AfterValidator(_gentle)]
Distortion = Annotated[tuple[float, float], BeforeValidator(_vector), AfterValidator(_unfolded)]
Row = tuple[float, float, float, float]
Colors = Annotated[str | Mapping[str, float] | tuple[Row, ...] | None, BeforeValidator(mixture)]


@gated
@described()
def photograph(
    view: Planform,
    packing: Packing,
    *,
    light: Annotated[Direction, option("Direction (x, y, z) to the light, above the horizon; of any length.")] = LIGHT,
    lamp: Annotated[
        float | None,
        option("Distance of a lamp in that direction, from the middle of the picture; without it the sun.", "m", gt=0),
    ] = None,
    ambient: Annotated[
        float,
        option(
            "Share of the light that comes from all the sky; it darkens what lies between grains. With 1 there are no "
            "shadows.",
            ge=0,
            le=1,
        ),
    ] = 0.4,
    brightness: Annotated[float, option("Grey of a level face of mean reflectance in full light.", gt=0)] = 0.6,
    variety: Annotated[
        float, option("Spread of the grains' reflectance: standard deviation of its logarithm.", ge=0, le=10)
    ] = 0.15,
    colors: Annotated[
        Colors,
        option(
            "Stones that grains are of, as quartz, or quartz:0.7,basalt:0.3 by number, or rows (red, green, blue, "
            "share): the image has three channels then."
        ),
    ] = None,
    texture: Annotated[
        float, option("Contrast within grains: standard deviation of the reflectance, over its mean.", ge=0, lt=1)
    ] = 0.0,
    texture_size: Annotated[float, option("Mean wavelength of texture, in mean diameters.", gt=0)] = 0.25,
    bands: Annotated[float, option("Share of the grains whose texture is bands, not speckles.", ge=0, le=1)] = 0.0,
    wet: Annotated[bool, option("Whether a film of water darkens grains and shines.")] = False,
    gloss: Annotated[float, option("Exponent of what shines on wet grains: larger is sharper.", gt=0)] = 50.0,
    gradient: Annotated[
        Gradient, option("Change of all light along x and y across the picture, over that in its middle.")
    ] = (0.0, 0.0),
    shadow: Annotated[
        float, option("How far the shadow of something outside reaches across the picture.", ge=0, le=1)
    ] = 0.0,
    shadow_side: Annotated[float, option("Side that it comes from, counter-clockwise from +x.", "rad")] = 0.0,
    shadow_width: Annotated[
        float | None, option("Breadth of it, as of a bar, over the way across; without end by default.", gt=0)
    ] = None,
    shadow_edge: Annotated[float, option("Breadth of its soft edge, over the way across.", ge=0)] = 0.05,
    vignette: Annotated[float, option("Share of the light that is lost in the corners, by cos⁴.", ge=0, lt=1)] = 0.0,
    lens: Annotated[
        Distortion,
        option(
            "Distortion k1 and k2 of Brown and Conrady, at r (1 + k1 r² + k2 r⁴), r = 1 in the corners: below zero a "
            "barrel, above a pincushion."
        ),
    ] = (0.0, 0.0),
    blur: Annotated[
        float, option("Standard deviation of the Gaussian that a point is spread to, in pixels.", ge=0)
    ] = 0.0,
    noise: Annotated[
        float, option("Standard deviation of the grey that is added to each pixel, after the blur.", ge=0)
    ] = 0.0,
    rng: np.random.Generator | int | None = None,
) -> Floats:
    """Return an image of a planform: 0 black, 1 white.

    Parameters
    ----------
    view : Planform
        What is seen of the packing.
    packing : Packing
        The same packing.
    rng : Generator, int or None
        Source of reflectances, colours, textures and noise.

    Returns
    -------
    ndarray, shape (ny, nx), or (ny, nx, 3) with colours
        Within [0, 1], linear in the light. The same view, options and seed give the same bytes on the same processor.

    Raises
    ------
    InputError
        If the packing is another than the view's, the lamp hangs among the grains, the lens folds the picture, or an
        option is out of its range.

    Notes
    -----
    Grey is ρ (k s + (1 - k) (n · l) e / l_z), ρ the grain's reflectance (Lambert), k the ambient share, s the share of
    the sky that the pixel sees above what is around it, n the normal of the face, l the unit vector to the light, and e
    one in its light, zero in the shadow of what is around it. The floor is drawn as a level face of mean reflectance.
    `CameraLens`, and in the folder ``camera`` `unevenness`, `passed`, `texture`, `drawn_colors`, `wet_reflectance`,
    `highlights` and `vignetting` say how the rest goes in. Reflectances above 1 are 1 where grains are wet.
    """
    _require_view(view, packing)
    camera = checked(
        camera_options(),
        {
            "light": light, "lamp": lamp, "ambient": ambient, "brightness": brightness, "variety": variety,
            "colors": colors, "texture": texture, "texture_size": texture_size, "bands": bands, "wet": wet,
            "gloss": gloss, "gradient": gradient, "shadow": shadow, "shadow_side": shadow_side,
            "shadow_width": shadow_width, "shadow_edge": shadow_edge, "vignette": vignette, "lens": lens, "blur": blur,
            "noise": noise,
        },
    )  # fmt: skip
    generator = np.random.default_rng(rng)
    glass = CameraLens.of(view, camera["lens"])
    albedo = _reflectances(view, packing, camera, generator)
    grey = glass.drawn(_lit(view, packing, albedo, camera))
    if vignette > 0:
        dimmed = vignetting(glass.radii(), vignette)
        grey = grey * (dimmed if grey.ndim == 2 else dimmed[..., None])
    if blur > max(grey.shape[:2]):
        raise InputError(f"blur must be at most the picture's longer edge, {max(grey.shape[:2])} pixels; got {blur:g}")
    if blur > 0:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (scipy.ndimage costs a tenth of a second)

        # What wraps around as a view does no longer through a lens.
        wraps = view.periodic[::-1] if glass.is_plain and vignette == 0 else (False, False)
        modes: list[Literal["wrap", "nearest"]] = ["wrap" if wrap else "nearest" for wrap in wraps]
        if grey.ndim == 2:
            grey = gaussian_filter(grey, blur, mode=modes)
        else:
            grey = gaussian_filter(grey, (blur, blur, 0), mode=[*modes, "nearest"])
    if noise > 0:
        grey = grey + noise * generator.standard_normal(grey.shape)
    return np.asarray(np.clip(grey, 0.0, 1.0))


def camera_options() -> Any:
    """Return the model of the options of `photograph`: for tables, commands and ranges."""
    return description(photograph).options


def _require_view(view: Planform, packing: Packing) -> None:
    """Raise `InputError` where a view shows grains or faces that a packing has not."""
    if view.labels.max(initial=0) > len(packing) or view.faces.max(initial=0) >= max(packing.grains.n_faces, 1):
        raise InputError(
            f"the view must be of this packing of {len(packing)} grains; it shows grain {view.labels.max() - 1}"
        )


def _reflectances(
    view: Planform, packing: Packing, camera: Mapping[str, Any], generator: np.random.Generator
) -> Floats:
    """Return the reflectance of each pixel, dry or wet, shape (ny, nx) or (ny, nx, 3)."""
    n = len(packing)
    reflectance = np.append(1.0, np.exp(camera["variety"] * generator.standard_normal(n)))
    if camera["colors"] is not None:
        reflectance = reflectance[:, None] * drawn_colors(camera["colors"], n, generator)
    albedo = camera["brightness"] * reflectance[view.labels]
    if camera["texture"] > 0 and n:
        seed = int(generator.integers(2**63))
        size = camera["texture_size"] * float(grain_diameters(packing).mean())
        varied = drawn_texture(view, packing, size=size, bands=camera["bands"], seed=seed)
        factor = np.maximum(1 + camera["texture"] * varied, 0.0)
        albedo *= factor if albedo.ndim == 2 else factor[..., None]
    return wet_reflectance(np.minimum(albedo, 1.0)) if camera["wet"] else albedo


def _lit(view: Planform, packing: Packing, albedo: Floats, camera: Mapping[str, Any]) -> Floats:
    """Return what comes from each pixel of the view, shape of ``albedo``."""
    heights = np.where(view.labels > 0, view.heights, view.floor)
    pixel, wraps = float(view.pixel.mean()), (bool(view.periodic[0]), bool(view.periodic[1]))
    normals = np.vstack([turned_normals(packing, face_planes(packing.grains).normals), [[0.0, 0.0, 1.0]]])
    # The last row is the floor's, which -1 finds.
    towards, ambient = np.asarray(camera["light"], dtype=np.float64), camera["ambient"]
    arriving = beam(view, heights, normals, towards / np.linalg.norm(towards), camera["lamp"])
    direct = arriving.strength
    if camera["shadow"] > 0:
        bar = CastShadow(*(camera[f"shadow{key}"] for key in ("", "_side", "_width", "_edge")))
        direct = direct * passed(view, heights, arriving.towards, bar)
    size = float(grain_diameters(packing).mean()) if len(packing) else pixel
    open_sky = sky(heights, pixel, REACH * size, wraps=wraps) if ambient > 0 else np.ones_like(heights)
    light = ambient * open_sky + (1 - ambient) * direct
    grey: Floats = albedo * (light if albedo.ndim == 2 else light[..., None])
    if camera["wet"]:
        shine = (1 - ambient) * direct * highlights(normals[view.faces], arriving.towards, camera["gloss"])
        grey = grey + (shine if grey.ndim == 2 else shine[..., None])
    if any(camera["gradient"]):
        uneven = unevenness(view, camera["gradient"])
        grey = grey * (uneven if grey.ndim == 2 else uneven[..., None])
    return grey
