"""Mode, owner and group of what the daemon creates, set before a reader can find it.

What is not configured is the system's default: the daemon's own user and group, and 0644 less the umask.
"""

import os
import stat
from collections.abc import Callable
from typing import Any, NamedTuple

_KEYS = ("mode", "owner", "group")
_LARGEST_ID = 2**32 - 2


class Access(NamedTuple):
    """What is configured of it."""

    mode: int | None = None
    owner: int = -1
    """The user's number; -1 where it stays, as :func:`os.chown` has it."""
    group: int = -1

    def for_socket(self) -> "Access":
        """The same for a socket: connecting needs the right to write, so that whoever may read may connect."""
        if self.mode is None:
            return self._replace(mode=0o666)
        return self._replace(mode=self.mode | (self.mode & 0o444) >> 1)


def grant(target: int | str, access: Access) -> None:
    """Set mode, owner and group of a descriptor or a path; raises OSError.

    An owner that is right already is not set again, as that alone would fail without CAP_CHOWN.
    """
    if access.mode is not None:
        os.chmod(target, access.mode)
    if (access.owner, access.group) != (-1, -1):
        found = os.stat(target)
        if access.owner not in (-1, found.st_uid) or access.group not in (-1, found.st_gid):
            os.chown(target, access.owner, access.group)


def described(path: str) -> str:
    """Mode and owner of what lies at ``path``, in numbers; raises OSError."""
    found = os.stat(path)
    return f"{stat.S_IMODE(found.st_mode):04o}, user {found.st_uid}, group {found.st_gid}"


def read_access(place: str, value: Any, base: Access, fault: Callable[[str, str, str], None]) -> Access:
    """``base`` with the configuration in ``value``; ``fault`` takes each thing that is wrong."""
    if not isinstance(value, dict):
        fault(place, f"is {value!r}", "a mapping with mode, owner and group is wanted")
        return base
    for key in value:
        if key not in _KEYS:
            fault(f"{place}.{key}", "unknown key", f"known are {', '.join(_KEYS)}")
    if "mode" in value:
        base = base._replace(mode=_mode(f"{place}.mode", value["mode"], fault))
    if "owner" in value:
        base = base._replace(owner=_identity(f"{place}.owner", value["owner"], "user", _user, fault))
    if "group" in value:
        base = base._replace(group=_identity(f"{place}.group", value["group"], "group", _group, fault))
    return base


def _mode(place: str, value: Any, fault: Callable[[str, str, str], None]) -> int | None:
    """Octal digits in quotes. A number is refused: 640 would be 01200, and 416 is ambiguous."""
    digits = value.removeprefix("0o") if isinstance(value, str) else ""
    if 3 <= len(digits) <= 4 and all(each in "01234567" for each in digits) and int(digits, 8) <= 0o777:
        return int(digits, 8)
    fault(place, f"is {value!r}", 'octal digits in quotes, "0000" to "0777", are wanted: "0640"')
    return None


def _identity(
    place: str, value: Any, kind: str, number_of: Callable[[str], int], fault: Callable[[str, str, str], None]
) -> int:
    """The number of a user or a group that is named, or given as a number."""
    if isinstance(value, str) and value:
        try:
            return number_of(value)
        except (KeyError, ImportError, ValueError):
            if not (value.isascii() and value.isdigit()):
                fault(place, f"there is no {kind} {value!r} here", f"create the {kind} first, or give its number")
                return -1
            value = int(value) if len(value) <= 10 else _LARGEST_ID + 1
    if type(value) is not int or not 0 <= value <= _LARGEST_ID:
        fault(place, f"is {value!r}", f"the name of a {kind}, or its number, is wanted")
        return -1
    return value


def _user(name: str) -> int:
    import pwd  # most configurations name no one

    return pwd.getpwnam(name).pw_uid


def _group(name: str) -> int:
    import grp

    return grp.getgrnam(name).gr_gid
