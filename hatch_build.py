"""What the build puts into a wheel besides: the bill of materials of PEP 770, made of what `pyproject.toml` says."""

from __future__ import annotations

import json
import shutil
import tempfile
import uuid
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.requirements import Requirement

UNUSED = {"test", "dev", "all"}
"""Extras that no use of the package needs, and the one that is made of the others."""


def bill(name: str, version: str, licence: str, required: list[str], optional: dict[str, list[str]]) -> dict[str, Any]:
    """Return a bill of materials as CycloneDX 1.7 has it.

    Nothing of others is in the wheel, so every component but our own is external: it has a range of versions, as the
    package asks for it, and what it depends on itself is not told.
    """
    us = f"pkg:pypi/{name}@{version}"
    asked = dict.fromkeys(required, "required")
    for extra, lines in optional.items():
        asked |= {line: "optional" for line in lines if extra not in UNUSED and line not in asked}
    needs = [(need, scope) for line, scope in asked.items() if (need := Requirement(line)).name != name]
    components = [_component(need, scope) for need, scope in sorted(needs, key=lambda pair: pair[0].name.lower())]
    refs = [component["bom-ref"] for component in components]
    told: dict[str, Any] = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.7",
        "version": 1,
        "metadata": {
            "lifecycles": [{"phase": "build"}],
            "component": {
                "type": "library",
                "bom-ref": us,
                "name": name,
                "version": version,
                "purl": us,
                "licenses": [{"license": {"id": licence, "acknowledgement": "declared"}}],
            },
        },
        "components": components,
        "dependencies": [{"ref": us, "dependsOn": refs}],
        "compositions": [
            {"aggregate": "complete", "assemblies": [us]},
            {"aggregate": "unknown", "dependencies": refs},
        ],
    }
    number = uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(told, sort_keys=True))  # the same for the same content
    return {**told, "serialNumber": f"urn:uuid:{number}"}


def _component(need: Requirement, scope: str) -> dict[str, Any]:
    purl = f"pkg:pypi/{need.name.lower()}"
    ends = sorted((part.version, part.operator) for part in need.specifier)
    return {
        "type": "library",
        "bom-ref": purl,
        "name": need.name,
        "versionRange": "vers:pypi/" + ("|".join(f"{operator}{version}" for version, operator in ends) or "*"),
        "isExternal": True,
        "purl": purl,
        "scope": scope,
    }


class BillHook(BuildHookInterface[Any]):
    """Writes the bill beside the sources for as long as the wheel is built."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002  (hatchling's own order)
        """Make the bill and have it put into the wheel."""
        core = self.metadata.core
        told = bill(
            core.name, self.metadata.version, core.license_expression, core.dependencies, core.optional_dependencies
        )
        self._folder = Path(tempfile.mkdtemp())
        path = self._folder / f"{core.name}.cdx.json"
        path.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
        build_data["sbom_files"].append(str(path))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Take the bill away again."""
        shutil.rmtree(self._folder)
