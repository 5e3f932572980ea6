"""What validation found."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from grainsdem.errors import ValidationError, name_offenders
from grainsdem.gate import gated_noun

if TYPE_CHECKING:
    from collections.abc import Iterable


@gated_noun
@dataclass(frozen=True, slots=True)
class Check:
    """One thing that validation looked at.

    Parameters
    ----------
    name : str
        What was looked at.
    ok : bool
        Whether it is as it should be.
    worst : float
        The worst value found, in ``unit``.
    threshold : float
        What is allowed, in ``unit``.
    unit : str
        Unit of both; empty for counts and ratios.
    offenders : tuple
        Grain ids, or pairs of them, that failed.
    note : str
        What a reader should know beside it.
    """

    name: str
    ok: bool
    worst: float
    threshold: float
    unit: str = ""
    offenders: tuple[Any, ...] = ()
    note: str = ""


@gated_noun
@dataclass(frozen=True, slots=True)
class Report:
    """What validation found.

    Parameters
    ----------
    checks : tuple of Check
        Everything that was looked at, failed or not.
    """

    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """Whether every check passed."""
        return all(check.ok for check in self.checks)

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that failed."""
        return tuple(check for check in self.checks if not check.ok)

    def raise_if_failed(self) -> Report:
        """Return the report itself, or raise `ValidationError` naming every failed check and its first offenders."""
        if not self.ok:
            raise ValidationError("; ".join(_describe(check) for check in self.failed))
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        names = [f.name for f in fields(Check)]
        return {
            "ok": self.ok,
            "checks": [{name: getattr(check, name) for name in names} for check in self.checks],
        }


def _describe(check: Check) -> str:
    unit = f" {check.unit}" if check.unit else ""
    text = f"{check.name}: worst {check.worst:.3g}{unit}, allowed {check.threshold:.3g}{unit}"
    return f"{text} (grains {name_offenders(_plain(check.offenders))})" if check.offenders else text


def _plain(ids: Iterable[Any]) -> list[str]:
    """Return ids and pairs of ids as text: 7, 3–9."""
    return ["–".join(map(str, i)) if isinstance(i, tuple) else str(i) for i in ids]
