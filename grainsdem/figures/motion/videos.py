"""Films in MPEG-4, written by ffmpeg from the pictures that an animation is made of."""

from __future__ import annotations

import shutil
import subprocess
from typing import TYPE_CHECKING

from grainsdem.errors import MissingPackageError, WriteError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from typing import Any

CODECS = ("libx264", "-crf", "20"), ("mpeg4", "-q:v", "3")
"""Codecs that are tried, with their quality: builds of ffmpeg without the first exist."""


def find_ffmpeg() -> str:
    """Return the path of ffmpeg: the one on the path, or that of the package imageio-ffmpeg.

    Raises
    ------
    MissingPackageError
        Where there is neither.
    """
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe  # noqa: PLC0415  (an extra)

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:  # the package can be there without its program
        raise MissingPackageError(
            'an .mp4 needs ffmpeg: put it on the path, or pip install "grainsdem[video]"; .gif and .webp need neither'
        ) from error


def write_film(pictures: Sequence[Any], path: Path, *, rate: float) -> None:
    """Write pictures of Pillow's, all of one size, as an MPEG-4 film.

    Parameters
    ----------
    pictures : sequence of PIL.Image.Image
        In RGB.
    path : pathlib.Path
        Where to; replaced if it exists.
    rate : float
        Pictures a second.

    Raises
    ------
    MissingPackageError
        Where ffmpeg is not found.
    WriteError
        If ffmpeg cannot write it; the message ends with what it said last.
    """
    program, (width, height) = find_ffmpeg(), pictures[0].size
    raw = b"".join(picture.tobytes() for picture in pictures)
    said = ""
    for codec in CODECS:
        # Players want even sides and colours at half the resolution; nothing of clock or version goes into the file.
        command = [
            program, "-hide_banner", "-loglevel", "error", "-y",
            "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate:.9g}", "-i", "-",
            "-an", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-c:v", *codec,
            "-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1", "-movflags", "+faststart",
            "-f", "mp4", str(path),
        ]  # fmt: skip
        done = subprocess.run(command, input=raw, capture_output=True, check=False)  # noqa: S603  (our own words)
        if done.returncode == 0:
            return
        said = done.stderr.decode(errors="replace").strip()
    raise WriteError(f"{path}: ffmpeg cannot write it: {said.splitlines()[-1] if said else 'it does not say why'}")
