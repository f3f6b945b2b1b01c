"""The command's door: nothing is imported before it is known what is wanted.

``run`` stays as small as it can: a child process reads the command line, the configuration and the model.
"""

from __future__ import annotations

import os
import sys

from ambientd import lean

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


def main() -> int:
    """Run the command line; returns its exit status."""
    arguments = sys.argv[1:]
    if hasattr(sys.stdout, "reconfigure"):  # a name may hold letters that this locale does not know
        sys.stdout.reconfigure(errors="backslashreplace")
    if arguments[:1] == ["run"] and not any([each.startswith("--re") for each in arguments]):  # --replay
        lean.install()
        return status_of(lambda: _run(arguments))
    from ambientd.cli import call

    return call(arguments)


def _run(arguments: Sequence[str]) -> None:
    from ambientd.handover import Child

    def begun() -> Child:
        return Child(lambda: _prepared(arguments))

    child = begun()
    from ambientd.run import run_sensors  # meanwhile

    run_sensors(child.result, lambda: begun().result())


def _prepared(arguments: Sequence[str]) -> object:
    from ambientd.cli import prepared

    return prepared(arguments)


def status_of(work: Callable[[], None]) -> int:
    """The exit status of ``work``; what is wrong is printed."""
    from ambient_model.faults import Refused

    try:
        work()
        sys.stdout.flush()
        return 0
    except Refused as refused:
        return _failed(str(refused))
    except BrokenPipeError:
        # what is still buffered has no reader: the interpreter's last flush goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        return _failed("stopped")
    except OSError as error:
        return _failed(f"{error.filename or 'output'}: {error.strerror or error}")


def _failed(message: str) -> int:
    print(f"ambientd: {message}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
