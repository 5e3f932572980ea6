"""A lens that bends straight lines and darkens corners."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated_noun
from grainsdem.model.arrays import check_within

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.measures.planform.views import Planform

    Floats = NDArray[np.float64]


@gated_noun
@dataclass(frozen=True, slots=True)
class CameraLens:
    """Radial distortion as Brown and Conrady write it, and programs of photogrammetry read it.

    Parameters
    ----------
    k1, k2 : float
        What is at a distance r from the middle is drawn at r (1 + k1 r² + k2 r⁴), r in half diagonals of the picture.
        Below zero is a barrel, above it a pincushion.
    shape : tuple of int
        Rows and columns of the picture.

    Raises
    ------
    InputError
        If the lens would draw two places on one.

    Notes
    -----
    The photograph is enlarged as little as shows nothing beyond the view: an edge of its pixels is `scale` times the
    view's in the middle. It is what a camera takes whose focal length is R / scale, in pixels, R half the diagonal.

    References
    ----------
    Brown, D. C. (1966). Decentering distortion of lenses. Photogrammetric Engineering 32, 444-462.
    """

    k1: float
    k2: float
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        # The slope 1 + 3 k1 w + 5 k2 w², w = r², is least at an end of the picture or where its own slope is zero.
        if min(1 + 3 * self.k1 * w + 5 * self.k2 * w * w for w in _turning(3 * self.k1, 5 * self.k2, 0.0)) <= 0:
            raise InputError(
                f"a lens must draw what is farther out farther out, 1 + 3 k1 r² + 5 k2 r⁴ > 0 up to the corner, r = 1; "
                f"got k1 = {self.k1:g}, k2 = {self.k2:g}"
            )

    @classmethod
    def of(cls, view: Planform, distortion: Sequence[float]) -> CameraLens:
        """Return the lens of a view with k1 and k2."""
        if len(distortion) != 2:
            raise InputError(f"distortion must be two numbers, k1 and k2; got {len(distortion)}")
        (k1, k2), (ny, nx) = distortion, view.labels.shape
        return cls(k1, k2, (ny, nx))

    @property
    def is_plain(self) -> bool:
        """Whether straight lines stay straight."""
        return self.k1 == 0 and self.k2 == 0

    @property
    def half_diagonal(self) -> float:
        """Half the diagonal of the picture [pixels]."""
        return 0.5 * float(np.hypot(*self.shape))

    @property
    def scale(self) -> float:
        """Edge of the photograph's pixels over the view's, in its middle."""
        nearest = (0.5 * min(self.shape) / self.half_diagonal) ** 2
        return min(1 + self.k1 * w + self.k2 * w * w for w in _turning(self.k1, self.k2, nearest))

    def outward(self, r: ArrayLike) -> Floats:
        """Return where a lens draws what is at distances r, both in half diagonals."""
        distance = np.asarray(r, dtype=np.float64)
        check_within("r", distance)
        w = distance * distance
        return np.asarray(distance * (1 + w * (self.k1 + w * self.k2)))

    def inward(self, drawn: ArrayLike) -> Floats:
        """Return how far from the middle is what is drawn at some distances: the inverse of `outward` up to r = 1."""
        target = np.asarray(drawn, dtype=np.float64)
        check_within("drawn", target)
        low, high = np.zeros_like(target), np.ones_like(target)
        r = np.clip(target, 0.0, 1.0)
        for _ in range(64):  # Newton's steps double the digits; halving, where one leaves the bracket, adds a third
            off = self.outward(r) - target
            low, high = np.where(off <= 0, r, low), np.where(off >= 0, r, high)
            w = r * r
            step = r - off / (1 + w * (3 * self.k1 + w * 5 * self.k2))
            following = np.where((step < low) | (step > high), 0.5 * (low + high), step)
            if np.abs(following - r).max(initial=0.0) < 1e-15:
                break
            r = following
        return r

    def radii(self) -> Floats:
        """Return how far each pixel of the photograph is from its middle [half diagonals], shape (ny, nx)."""
        y, x = self._offsets()
        return np.asarray(np.hypot(y, x) / self.half_diagonal)

    def places(self) -> tuple[Floats, Floats]:
        """Return rows and columns of the view, not whole ones, that pixels of the photograph show, shape (ny, nx)."""
        drawn = self.radii()
        shown = self.inward(self.scale * drawn)
        ratio = np.divide(shown, drawn, out=np.ones_like(drawn), where=drawn > 0)
        (y, x), (ny, nx) = self._offsets(), self.shape
        return y * ratio + 0.5 * (ny - 1), x * ratio + 0.5 * (nx - 1)

    def nearest(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Return labels, depths or whatever cannot be mixed as the photograph shows it: that of the nearest pixel."""
        self._hold(picture)
        if self.is_plain:
            return picture
        rows, columns = (np.rint(place).astype(np.int64) for place in self.places())
        return np.asarray(picture[np.clip(rows, 0, self.shape[0] - 1), np.clip(columns, 0, self.shape[1] - 1)])

    def drawn(self, picture: Floats) -> Floats:
        """Return a picture, shape (ny, nx) or (ny, nx, 3), as the photograph shows it: linear between pixels."""
        self._hold(picture)
        if self.is_plain:
            return picture
        from scipy.ndimage import map_coordinates  # noqa: PLC0415  (scipy.ndimage costs a tenth of a second)

        places = np.stack(self.places())
        channels = picture[..., None] if picture.ndim == 2 else picture
        shown = [map_coordinates(channels[..., c], places, order=1, mode="nearest") for c in range(channels.shape[2])]
        return np.stack(shown, axis=-1).reshape(picture.shape)

    def _hold(self, picture: NDArray[Any]) -> None:
        """Raise `ShapeError` unless a picture is of the lens's shape."""
        if picture.shape[:2] != tuple(self.shape):
            raise ShapeError(f"picture must have the lens's shape, {tuple(self.shape)}; got {picture.shape}")

    def camera_matrix(self) -> list[list[float]]:
        """Return the matrix that photogrammetry has beside k1 and k2 [pixels], the middle of pixel (0, 0) at (0, 0)."""
        focal, (ny, nx) = self.half_diagonal / self.scale, self.shape
        return [[focal, 0.0, 0.5 * (nx - 1)], [0.0, focal, 0.5 * (ny - 1)], [0.0, 0.0, 1.0]]

    def _offsets(self) -> tuple[Floats, Floats]:
        """Return how far each pixel's middle is from the picture's, down and to the right [pixels]."""
        ny, nx = self.shape
        y, x = np.meshgrid(np.arange(ny) - 0.5 * (ny - 1), np.arange(nx) - 0.5 * (nx - 1), indexing="ij")
        return y, x


def vignetting(radii: Floats, loss: float) -> Floats:
    """Return the share of the light that reaches each pixel, by the law of cos⁴.

    Parameters
    ----------
    radii : ndarray
        Distances from the picture's middle, 1 in its corners.
    loss : float
        Share that is lost in the corners, in [0, 1).

    Notes
    -----
    cos⁴ θ = (1 + κ r²)⁻², κ such that what is left at r = 1 is one minus the loss.
    """
    bend = 1 / np.sqrt(1 - loss) - 1
    return np.asarray((1 + bend * radii**2) ** -2.0)


def _turning(a: float, b: float, low: float) -> list[float]:
    """Return where a w + b w² may be least for w in [low, 1]."""
    vertex = -a / (2 * b) if b else low
    return [low, 1.0, *([vertex] if low < vertex < 1 else [])]
