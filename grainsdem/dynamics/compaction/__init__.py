"""Making beds denser: isotropic compression by six walls, and tapping."""

from grainsdem.dynamics.compaction.isotropic import CompactReport, compact
from grainsdem.dynamics.compaction.tapping import TapReport, tap

__all__ = ["CompactReport", "TapReport", "compact", "tap"]
