"""The command's door: nothing is imported before it is known what is wanted.

``run`` stays as small as it can: a child process reads the command line, the configuration and the model.
"""

from __future__ import annotations

import os
import sys

from ambientd import lean

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence


def main() -> int:
    """Run the command line; returns its exit status."""
    arguments = sys.argv[1:]
    # what was closed of input, output and error would become the next file's number, and take the log
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(descriptor)
    sys.stdout, sys.stderr = sys.stdout or os.fdopen(1, "w"), sys.stderr or os.fdopen(2, "w")
    if hasattr(sys.stdout, "reconfigure"):  # a name may hold letters that this locale does not know
        sys.stdout.reconfigure(errors="backslashreplace")
    if arguments[:1] == ["run"] and not any([each.startswith("--re") for each in arguments]):  # --replay
        lean.install()
        from ambientd.exit_status import status_of

        return status_of(lambda: _run(arguments))
    from ambientd.cli import call

    return call(arguments)


def _run(arguments: Sequence[str]) -> None:
    from ambientd.handover import Child

    def prepared() -> object:
        from ambientd import cli

        return cli.prepared(arguments)

    child = Child(prepared)
    from ambientd.run import run_sensors  # meanwhile

    run_sensors(child.result, lambda: Child(prepared).result())


if __name__ == "__main__":
    sys.exit(main())
