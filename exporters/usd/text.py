"""USD as text and as a crate, the one from the other: OpenUSD itself does it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from grainsdem.errors import WriteError

if TYPE_CHECKING:
    from collections.abc import Iterable


def text_of(layer: Iterable[bytes]) -> bytes:
    """Return the text that OpenUSD makes of a crate."""
    from pxr import Sdf

    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "layer.usdc"
        _write(source, layer)
        text: str = Sdf.Layer.FindOrOpen(str(source)).ExportToString()
        return text.encode()


def crate_of(text: bytes) -> bytes:
    """Return the crate that OpenUSD makes of text."""
    from pxr import Sdf

    with tempfile.TemporaryDirectory() as folder:
        source, packed = Path(folder) / "layer.usda", Path(folder) / "layer.usdc"
        _write(source, [text])
        Sdf.Layer.FindOrOpen(str(source)).Export(str(packed))
        return packed.read_bytes()


def _write(source: Path, content: Iterable[bytes]) -> None:
    try:
        with source.open("wb") as file:
            file.writelines(content)
    except OSError as error:
        raise WriteError(f"{source}: cannot be written: {error.strerror or error}") from error
