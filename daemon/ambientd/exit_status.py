"""What a command's end is to the shell: its status, and one line on what is wrong."""

import os
import sys
from collections.abc import Callable

from ambient_model.faults import Refused


def status_of(work: Callable[[], None]) -> int:
    """The exit status of ``work``; what is wrong is printed."""
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
