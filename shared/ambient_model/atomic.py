"""A file is replaced whole or not at all: a reader never sees half, a failure leaves the old one."""

import contextlib
import errno
import os
from collections.abc import Iterator
from typing import IO

from ambient_model.faults import refuse

_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""The errors of a write that are the disk's, where they name no file."""


@contextlib.contextmanager
def replacing(path: str, mode: str = "w") -> Iterator[IO[str]]:
    """Open a temporary neighbour of ``path`` for text; rename it over ``path`` when the block ends without an error.

    ``mode`` is ``"w"``, or ``"gz"`` for gzip-compressed text. The content reaches the disk before the rename.
    Raises :class:`~ambient_model.faults.Refused` where the folder is missing or not writable, the disk is full, or
    ``path`` is a folder or a device. An error that the block brings from elsewhere passes through as it is.
    """
    if os.path.exists(path) and not os.path.isfile(path):  # a rename would put a file in the place of /dev/null
        raise refuse(path, "", "cannot be written (it is a folder or a device)", "name a file")
    target = os.path.realpath(path)  # a rename over a link would leave what it leads to as it was
    temporary = f"{target}.{os.getpid()}.part"
    try:
        with _opened(temporary, mode) as stream:
            yield stream
        flush_to_disk(temporary)
        os.replace(temporary, target)
    except OSError as error:
        if error.filename not in (None, temporary) or (error.filename is None and error.errno not in _DISK):
            raise
        raise refuse(path, "", f"cannot be written ({error.strerror or error})", _hint(error)) from error
    finally:
        with contextlib.suppress(OSError):
            os.unlink(temporary)


def _opened(path: str, mode: str) -> IO[str]:
    if mode == "gz":
        import gzip  # only the host writes compressed traces: the device needs none of it

        return gzip.open(path, "wt", encoding="utf-8", newline="")
    return open(path, "w", encoding="utf-8", newline="")


def flush_to_disk(path: str) -> None:
    """Bring a file's content to the disk, or a folder's names."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _hint(error: OSError) -> str:
    return {
        errno.ENOENT: "make the folder first, or name another",
        errno.ENOTDIR: "name a folder that exists",
        errno.EACCES: "choose a folder that you may write to",
        errno.EROFS: "choose a file system that is not read-only",
        errno.ENOSPC: "free some disk space and run it again; an existing file was left as it was",
        errno.EDQUOT: "free some of your quota and run it again; an existing file was left as it was",
    }.get(error.errno or 0, "see that the folder exists, is writable and has room")
