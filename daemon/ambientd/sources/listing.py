"""What a folder of sysfs lists: its numbered entries in order, and the one line that an attribute holds."""

import os
from collections.abc import Iterable


def numbered(folder: str, prefix: str, suffix: str) -> list[str]:
    """The paths of the entries ``<prefix>N<suffix>``, in the order of N; none where the folder cannot be read."""
    try:
        names = os.listdir(folder)
    except OSError:
        return []
    found = []
    for name in names:
        number = name.removeprefix(prefix).removesuffix(suffix)
        if name == f"{prefix}{number}{suffix}" and number.isascii() and number.isdigit():
            found.append((int(number), os.path.join(folder, name)))
    return [path for _, path in sorted(found)]


def first_line(path: str) -> str:
    """The first line of the attribute, without the space around it; empty where it cannot be read."""
    try:
        with open(path, encoding="utf-8", errors="replace") as stream:
            return stream.readline(256).strip()
    except OSError:
        return ""  # what goes away while it is looked at


def offered(what: str, names: Iterable[str], where: str = "'sensors'") -> str:
    """A hint that lists what could be named instead."""
    return f"{what} are {', '.join(sorted(names)) or 'none'}: name one of them under {where}"
