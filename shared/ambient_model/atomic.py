"""A file is replaced whole or not at all: a reader never sees half, a failure leaves the old one."""

import contextlib
import os
from collections.abc import Iterator
from typing import IO

from ambient_model.faults import refuse


@contextlib.contextmanager
def replacing(path: str, mode: str = "w") -> Iterator[IO[str]]:
    """Open a temporary neighbour of ``path`` for text; rename it over ``path`` when the block ends without an error.

    ``mode`` is ``"w"``, or ``"gz"`` for gzip-compressed text. The content reaches the disk before the rename.
    Raises :class:`~ambient_model.faults.Refused` where the folder is missing or not writable, or the disk is full.
    """
    temporary = f"{path}.{os.getpid()}.part"
    try:
        with _opened(temporary, mode) as stream:
            yield stream
        _flush_to_disk(temporary)
        os.replace(temporary, path)
    except OSError as error:
        if error.filename not in (None, temporary, path):
            raise
        raise refuse(path, "", f"cannot be written ({error.strerror or error})", _mend(error)) from error
    finally:
        with contextlib.suppress(OSError):
            os.unlink(temporary)


def _opened(path: str, mode: str) -> IO[str]:
    if mode == "gz":
        import gzip  # only the host writes compressed traces: the device should not pay for the import

        return gzip.open(path, "wt", encoding="utf-8", newline="")
    return open(path, "w", encoding="utf-8", newline="")


def _flush_to_disk(path: str) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _mend(error: OSError) -> str:
    import errno

    return {
        errno.ENOENT: "make the folder first, or name another",
        errno.ENOTDIR: "name a folder that exists",
        errno.EACCES: "choose a folder that you may write to",
        errno.EROFS: "choose a file system that is not read-only",
        errno.ENOSPC: "free some disk space and run it again; an existing file was left as it was",
        errno.EISDIR: "name a file, not a folder",
    }.get(error.errno or 0, "see that the folder exists, is writable and has room")
