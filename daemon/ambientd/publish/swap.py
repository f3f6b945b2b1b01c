"""A published file changes by rename, so that a reader never sees half of it, nor one that it may not see.

Unlike a model or a trace it need not outlive a power cut, and is not flushed to the disk: ten flushes a second wear
out the flash. Until the rename it is a neighbour, ``PATH.PID.part``, which stays behind only where the process is
killed; :func:`sweep` removes it then.
"""

import errno
import os

from ambientd.publish.access import Access, described, grant

_AS_USUAL = Access()
_CREATE = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
_PART = f".{os.getpid()}.part"
"""Its name is this process's for good: it is never forked."""


def put(path: str, content: bytes, access: Access) -> int:
    """Replace the file at ``path`` by one that holds ``content``, and return that one's descriptor.

    Raises OSError, and then leaves the old file as it was.
    """
    temporary = path + _PART
    is_usual = access == _AS_USUAL
    descriptor = -1
    try:
        descriptor = _created(temporary, 0o644 if is_usual or access.mode is None else 0o600)
        if os.write(descriptor, content) < len(content):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)
        if not is_usual:
            grant(descriptor, access)
        os.rename(temporary, path)
        return descriptor
    except BaseException:  # an alarm, too, that ends a write which blocks
        if descriptor >= 0:
            os.close(descriptor)
        try:
            os.unlink(temporary)
        except OSError:
            pass
        raise


def give_up(path: str) -> None:
    """Remove the neighbour that a thread which hangs in :func:`put` would rename later."""
    remove(path + _PART)


def _created(path: str, mode: int) -> int:
    """A file that is new: what lies there is of a killed process with the same number, or hostile."""
    try:
        return os.open(path, _CREATE, mode)
    except FileExistsError:
        os.unlink(path)
        return os.open(path, _CREATE, mode)


def swap_in(path: str, content: bytes, access: Access) -> None:
    """As :func:`put`, without the descriptor."""
    os.close(put(path, content, access))


def trial(path: str, access: Access) -> str:
    """Make the neighbour that :func:`put` would rename, and remove it: its mode and owner; raises OSError."""
    temporary = path + _PART
    try:
        os.close(_created(temporary, 0o644 if access.mode is None else 0o600))
        grant(temporary, access)
        return described(temporary)
    finally:
        remove(temporary)


def remove(path: str) -> None:
    """Remove the file at ``path``, if it is there."""
    try:
        os.unlink(path)
    except FileNotFoundError:
        pass


def sweep(path: str) -> None:
    """Remove the unfinished neighbours of ``path`` whose processes are no more; what cannot be removed stays."""
    folder, name = os.path.split(path)
    try:
        for found in os.listdir(folder or "."):
            process = found.removeprefix(f"{name}.").removesuffix(".part")
            if found == f"{name}.{process}.part" and process.isascii() and process.isdigit() and not _lives(process):
                os.unlink(os.path.join(folder, found))
    except OSError:
        pass


def _lives(process: str) -> bool:
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True
