"""Which of VTK's windows can draw here. Without a working OpenGL library VTK does not fail, it ends the process."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_TRIAL = """
import sys
from vtkmodules import vtkRenderingOpenGL2 as gl
window = getattr(gl, sys.argv[1])()
window.SetOffScreenRendering(1)
window.SetSize(8, 8)
if not window.SupportsOpenGL():
    sys.exit(1)
window.Render()
"""


@cache
def find_window() -> str | None:
    """Return the class of VTK's window that draws off screen here; empty for VTK's own choice, None where none does.

    Notes
    -----
    On Linux the wheel of VTK loads EGL, OSMesa or X11 from the system, and a container as a rule has none of them
    (on Debian and Ubuntu ``libegl1`` is enough). Each is tried in a process of its own, since a trial may crash.
    """
    if not sys.platform.startswith("linux"):
        return ""
    candidates = ["vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow"]
    if os.environ.get("DISPLAY"):
        candidates.append("vtkXOpenGLRenderWindow")
    return next((name for name in candidates if _works(name)), None)


@contextmanager
def using(window: str) -> Iterator[None]:
    """Have VTK open this class of window, and say nothing short of an error on stderr meanwhile."""
    from vtkmodules.vtkCommonCore import vtkLogger  # noqa: PLC0415  (comes with PyVista, heavy)

    variable = "VTK_DEFAULT_OPENGL_WINDOW"
    before, verbosity = os.environ.get(variable), vtkLogger.GetCurrentVerbosityCutoff()
    if window:
        os.environ[variable] = window
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        if window:
            os.environ.pop(variable, None)
            if before is not None:
                os.environ[variable] = before


def _works(window: str) -> bool:
    try:
        trial = subprocess.run(  # noqa: S603  (our own interpreter and text)
            [sys.executable, "-c", _TRIAL, window], capture_output=True, timeout=60, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return trial.returncode == 0
