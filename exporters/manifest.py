"""The page beside the files of a folder: what they were made from, in which units, and what each leaves out.

``manifest.json`` holds the packing's size, porosity and smallest gap, its provenance and the seeds in it, the versions
that wrote it, and for every format its options, the factors from its units to SI, what it loses, what it did to the
grains (such as rounding them), and the SHA-256 and size of each of its files; where formats could not take the packing,
``refused`` says why. It has no clock, host or path in it: the same packing gives the same bytes.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.check import measured
from grainsdem.errors import GrainsDEMError, InputError, WriteError
from grainsdem.measures import porosity
from grainsdem.packing import contacts
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from exporters.formats import Found
    from grainsdem.model import Packing

NAME = "manifest.json"
"""File name of the manifest."""

SCHEMA = 1
"""Version of what the manifest holds."""

_SI = {"length": 1.0, "mass": 1.0, "time": 1.0}
_PACKAGES = ("grainsdem", "numpy", "usd-core", "mujoco")


def together(
    packing: Packing, found: Sequence[Found], name: str, options: Sequence[Any]
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the files of many formats, and which formats could not take the packing, with their reasons.

    The manifest is the last file: it is made when all others have been written.

    Raises
    ------
    InputError
        If no format is given, one is given twice, two write the same file, or none can take the packing.
    """
    if not found:
        raise InputError("formats must name at least one format; got none")
    content: dict[str, Any] = {}
    digests: dict[str, dict[str, Any]] = {}
    rows: list[dict[str, Any]] = []
    refused: dict[str, str] = {}
    for one, chosen in zip(found, options, strict=True):
        # A format that is a folder gets one of its own among others.
        folder = "" if one.suffix or len(found) == 1 else f"{one.name}/"
        try:
            written = one.module.files(packing, name=name, suffix=one.suffix, options=chosen)
            told = one.module.report(packing, chosen) if hasattr(one.module, "report") else {}
        except WriteError:
            raise
        except GrainsDEMError as error:
            names = [other.name for other in found]
            refused[one.name if names.count(one.name) == 1 else f"{one.name}{one.suffix}"] = str(error)
            if one is found[-1] and not rows:
                raise
            continue
        named = {folder + file: part for file, part in written.items()}
        shared = [file for file in named if file in content]
        if shared:
            raise InputError(f"{one.name}{one.suffix} writes {shared[0]}, which a format before it writes too")
        content |= {file: _counted(part, file, digests) for file, part in named.items()}
        rows.append({
            "format": one.name,
            "options": asdict(chosen),
            "units": one.module.factors(packing, chosen) if hasattr(one.module, "factors") else _SI,
            "loses": list(one.module.LOSES),
            **({"report": told} if told else {}),
            "files": list(named),
        })  # fmt: skip
    content[NAME] = _text(packing, name, rows, refused, digests)
    return content, refused


def _counted(content: bytes | Iterable[bytes], file: str, digests: dict[str, dict[str, Any]]) -> Iterator[bytes]:
    """Yield content as it comes, and note its digest and size when it has ended."""
    digest, size = hashlib.sha256(), 0
    for block in [content] if isinstance(content, bytes) else content:
        digest.update(block)
        size += len(block)
        yield block
    digests[file] = {"name": file, "bytes": size, "sha256": digest.hexdigest()}


def _text(
    packing: Packing,
    name: str,
    rows: list[dict[str, Any]],
    refused: dict[str, str],
    digests: dict[str, dict[str, Any]],
) -> Iterator[bytes]:
    """Yield the manifest; the digests are known once the files before it are written."""
    document = {
        "schema": SCHEMA,
        "name": name,
        "packing": _facts(packing),
        "provenance": [json.loads(step) for step in packing.provenance],
        "versions": {package: found for package in _PACKAGES if (found := _version(package))},
        "formats": [{**row, "files": [digests[file] for file in row["files"]]} for row in rows],
        **({"refused": refused} if refused else {}),
    }
    yield (json.dumps(document, indent=2, ensure_ascii=False, default=_plain) + "\n").encode()


def _facts(packing: Packing) -> dict[str, Any]:
    """Return what a reader can check a file against, in SI."""
    integrals = measured(packing)
    graph = contacts(packing)
    domain = packing.domain
    return {
        "n_grains": len(packing),
        "mass": float(packing.densities @ integrals.volumes),
        "volume": float(integrals.volumes.sum()),
        "median_diameter": float(np.median(cube_roots(6.0 / np.pi * integrals.volumes))),
        "domain": {
            "lower": domain.lower.tolist(),
            "upper": domain.upper.tolist(),
            "periodic": domain.periodic.tolist(),
            "is_planar": domain.is_planar,
            "planes": domain.planes.tolist(),
        },
        "porosity_of_domain": porosity(packing, region="domain"),
        "smallest_gap": float(graph.gaps.min()) if len(graph) else None,
        "seeds": [seed for step in packing.provenance for seed in _seeds(json.loads(step))],
    }


def _seeds(value: Any) -> Iterator[Any]:
    """Yield every number that a step of the provenance was seeded with."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key in ("rng", "seed") and not isinstance(inner, dict):
                yield inner
            else:
                yield from _seeds(inner)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _plain(value: Any) -> Any:
    """Return arrays and their numbers as JSON values."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
