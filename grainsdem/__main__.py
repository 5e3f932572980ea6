"""The program. Until a command begins, and once it has ended, nothing is to be tidied: signals end the process at once.

What is imported before that is said is little.
"""

from __future__ import annotations

import signal
import sys


def main() -> None:
    """Run the command line."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from grainsdem.cli import main as run  # noqa: PLC0415  (it takes a quarter of a second)
    from grainsdem.cli.guard import INTERRUPTED, TERMINATED  # noqa: PLC0415  (the same)

    try:
        run()
    except SystemExit as ended:
        if ended.code in (INTERRUPTED, TERMINATED):
            # What a library had half made complains as it goes.
            sys.unraisablehook = lambda _: None
        raise


if __name__ == "__main__":
    main()
