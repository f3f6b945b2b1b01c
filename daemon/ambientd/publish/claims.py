"""What this process alone writes: a lock on ``PATH.lock`` beside each file, and no file of another user in its place.

The lock goes with the process, however that ends. Nobody else may open it, so that nobody else can hold it.
"""

import os
import stat
from collections.abc import Iterable

from ambient_model.faults import refuse

_LOCK = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
_ANOTHER = "stop the other first, or choose another path"


class Claims:
    """The paths that are claimed."""

    def __init__(self) -> None:
        self.held: dict[str, int] = {}
        """The descriptor of each path's lock."""

    def take(self, path: str) -> None:
        """Claim ``path``; again is once.

        Raises :class:`~ambient_model.faults.Refused` where it is another's, and OSError where no lock can be made.
        """
        while path not in self.held:
            _refuse_foreign(path)
            _refuse_foreign(f"{path}.lock")
            descriptor = os.open(f"{path}.lock", _LOCK, 0o600)
            try:
                os.lockf(descriptor, os.F_TLOCK, 0)
                if os.path.samestat(os.fstat(descriptor), os.stat(f"{path}.lock")):
                    self.held[path] = descriptor
            except FileNotFoundError:  # removed by who has just released it
                continue
            except (BlockingIOError, PermissionError):
                raise refuse(path, "", "another daemon publishes there", _ANOTHER) from None
            finally:
                if path not in self.held:
                    os.close(descriptor)

    def keep(self, paths: Iterable[str]) -> None:
        """Release all others."""
        for path in self.held.keys() - set(paths):
            try:
                os.unlink(f"{path}.lock")
            except OSError:
                pass
            os.close(self.held.pop(path))


def _refuse_foreign(path: str) -> None:
    """Refuse a device, a pipe or a socket that lies there, and another user's file that only they may remove."""
    try:
        found, folder = os.lstat(path), os.stat(os.path.dirname(path) or ".")
    except OSError:
        return
    if stat.S_IFMT(found.st_mode) not in (stat.S_IFREG, stat.S_IFLNK, stat.S_IFDIR):  # a rename would replace it
        raise refuse(path, "", "exists and is no file", "choose another path")
    me = os.geteuid()
    if folder.st_mode & stat.S_ISVTX and me != 0 and me not in (found.st_uid, folder.st_uid):
        raise refuse(path, "", f"belongs to user {found.st_uid}, in a folder of many", "choose a folder of your own")


def open_own(path: str, owner: int) -> int:
    """A descriptor to write into the file that lies there; raises OSError where it may be another user's, or a link."""
    descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    found = os.fstat(descriptor)
    if stat.S_ISREG(found.st_mode) and found.st_nlink == 1 and found.st_uid in (0, os.geteuid(), owner):
        return descriptor
    os.close(descriptor)
    raise PermissionError(f"{path} is no file of this daemon's own")
