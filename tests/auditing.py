"""Ask what is known against the versions installed of all that the package needs: ``python tests/auditing.py``.

It fails where something is known. Where no service that knows can be reached, it says so and does not fail.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

OUT_OF_REACH = ("ConnectionError", "ConnectTimeout", "ReadTimeout", "Could not connect", "Max retries", "ServiceError")
"""What is in the last words of pip-audit where the network is the reason."""


def installed(asked):
    """Return the versions by name that fulfil a requirement here, and all that those need in turn."""
    found, waiting, seen = {}, [Requirement(asked)], set()
    while waiting:
        need = waiting.pop()
        key = need.name.lower(), frozenset(need.extras)
        if key in seen:
            continue
        seen.add(key)
        try:
            held = distribution(need.name)
        except PackageNotFoundError:
            continue  # an extra's, on another system
        found[held.metadata["Name"].lower()] = held.version
        for line in held.requires or ():
            other = Requirement(line)
            if other.marker is None or any(other.marker.evaluate({"extra": extra}) for extra in ("", *need.extras)):
                waiting.append(other)
    return found


def ask(versions):
    """Return the exit status of pip-audit for some versions, its answer and its words."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pinned.txt"
        path.write_text("".join(f"{name}=={version}\n" for name, version in sorted(versions.items())))
        command = [sys.executable, "-m", "pip_audit", "-r", path, "--no-deps", "--disable-pip", "-f", "json"]
        done = subprocess.run(
            [*command, "--progress-spinner", "off", "--timeout", "15"], capture_output=True, text=True, check=False
        )
    return done.returncode, done.stdout, done.stderr


def judged(code, answer, words):
    """Return whether what pip-audit answered is no failure, and the lines that say it."""
    try:
        told = json.loads(answer)["dependencies"]
    except (ValueError, KeyError):
        last = (words.strip().splitlines() or [f"exit status {code}"])[-1]
        if any(sign in words for sign in OUT_OF_REACH):
            return True, [f"nothing was audited: no service of known vulnerabilities can be reached ({last[:120]})"]
        return False, [f"pip-audit gave no answer: {last}"]
    known = [(one["name"], one["version"], flaw) for one in told for flaw in one.get("vulns", ())]
    passed = [one["name"] for one in told if "skip_reason" in one]
    lines = [
        f"{name} {version}: {flaw['id']}, mended in {', '.join(flaw['fix_versions']) or 'no version yet'}"
        for name, version, flaw in known
    ]
    if told and len(passed) == len(told):
        return True, [f"nothing was audited: the service knows none of {len(told)} packages"]
    if passed:
        lines.append(f"not audited: {', '.join(sorted(passed))}")
    lines.append(f"{len(told) - len(passed)} packages audited, {len(known)} known vulnerabilities")
    return not known, lines


def main():
    versions = installed("grainsdem[all]")
    versions.pop("grainsdem", None)  # no index need know it
    ok, lines = judged(*ask(versions))
    sys.stdout.write("\n".join([*lines, ""]))
    sys.exit(not ok)


if __name__ == "__main__":
    main()
