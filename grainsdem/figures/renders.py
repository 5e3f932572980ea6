"""Renders: the grains in three dimensions, off screen."""

from __future__ import annotations

import importlib.util
import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING

from grainsdem.atomic import replacing
from grainsdem.errors import InputError, MissingPackageError
from grainsdem.figures import opengl, painter
from grainsdem.figures.frame import check_suffix
from grainsdem.figures.scene import set_scene
from grainsdem.figures.windows import find_window, using
from grainsdem.gate import gated
from grainsdem.looks import View  # noqa: TC001  (read at the door: `grainsdem.gate`)

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import ArrayLike

    from grainsdem.figures.scene import Scene
    from grainsdem.model import Packing

logger = logging.getLogger(__name__)


@gated
def render(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    color_by: str | ArrayLike = "diameter",
    size: tuple[int, int] = (1200, 900),
    view: View | None = None,
) -> Path:
    """Draw the grains in three dimensions, with the container's outline.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    path : str or path-like
        Ends in ``.png``; replaced if it exists.
    color_by : {"diameter", "sphericity", "height", "id", "class", "layers", "columns", "halves"} or array_like
        What the colour of a grain shows: a quantity with a scale beside it, ``"id"`` to tell neighbours apart, or in
        which of five layers or columns, or of two halves, left and right, it is; or one value a grain, shape (n,).
    size : tuple of int
        Width and height [pixels].
    view : {"corner", "front", "side", "top"}, optional
        Over a corner of the container, or straight on without perspective: from −y, +x or +z, from +z, +x or +y in
        planar work. By default over a corner, in planar work from the front.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    InputError
        If there is no grain, or ``color_by``, ``size`` or ``view`` is not one of the above.
    MissingPackageError
        Where PyVista is not installed.
    WriteError
        If the file cannot be written.

    Notes
    -----
    PyVista draws off screen and needs no display, only an OpenGL library: EGL or OSMesa. Where the machine has neither
    (a bare container; ``apt install libegl1`` mends it), matplotlib paints a plainer picture of the same scene.
    """
    target = check_suffix(path)
    if len(packing) == 0:
        raise InputError("there is nothing to draw: the packing has no grains")
    scene = set_scene(packing, color_by, view)
    with painting(size) as draw, replacing(target) as temporary:
        draw(scene, temporary)
    return target


@contextmanager
def painting(size: tuple[int, int], *, fine: bool = True) -> Iterator[Callable[[Scene, Path], None]]:
    """Yield a function that draws a scene into a PNG file of a size in pixels; it may be called again and again.

    Fine pictures have shade in the gaps and smooth edges; without they take a tenth of the time.

    Raises
    ------
    InputError
        If the size is none.
    MissingPackageError
        Where PyVista is not installed.
    """
    if min(size) < 16 or max(size) > 16384:
        raise InputError(f"size must be 16 to 16384 pixels each way; got {size[0]} × {size[1]}")
    if importlib.util.find_spec("pyvista") is None:
        raise MissingPackageError('render needs PyVista: pip install "grainsdem[viz]"')
    window = find_window()
    if window is None:
        logger.info("no OpenGL works here; matplotlib paints")
        yield lambda scene, path: painter.draw(scene, path, size)
    else:
        with using(window):
            yield lambda scene, path: opengl.draw(scene, path, size, fine=fine)
