"""A published file changes by rename, so that a reader never sees half of it.

Unlike a model or a trace it need not outlive a power cut, and is not flushed to the disk: ten flushes a second wear
out the flash.
"""

import contextlib
import os


def swap_in(path: str, content: bytes) -> None:
    """Replace the file at ``path`` by one that holds ``content``; raises OSError, and then leaves it as it was."""
    temporary = f"{path}.{os.getpid()}.part"
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    try:
        try:
            if os.write(descriptor, content) < len(content):
                raise OSError(28, "No space left on device", path)
        finally:
            os.close(descriptor)
        os.rename(temporary, path)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def remove(path: str) -> None:
    """Remove the file at ``path``, if it is there."""
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)
