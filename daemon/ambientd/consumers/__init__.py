"""Programs that read what is published, found by their own configuration: for ``ambientd check``.

A new one is one new module ``ambientd/consumers/NAME.py`` with ``reads(root)``, which returns each :class:`Reading` of
the program that is configured under the folder ``root``; nothing where it is not installed.
"""

import os
import pwd
import stat
from typing import NamedTuple

from ambient_model.faults import Fault
from ambientd.kinds import known
from ambientd.publish.spec import Spec


class Reading(NamedTuple):
    """A file that a program reads."""

    path: str
    user: str
    """The account that it runs as."""
    acts_from_millidegC: int | None = None
    """It does all it can from this value on; None where it acts on none."""
    shuts_down_from_millidegC: int | None = None
    missing: str = ""
    """What it makes of a missing file, where it acts on values."""
    is_named: bool = True
    """Whether its configuration names this very file, which then must be published."""


def followed(specs: tuple[Spec, ...], root: str = "/") -> tuple[list[str], list[Fault]]:
    """The chain from each of ``specs`` to its readers: what was found, and what is wrong."""
    published = {os.path.realpath(spec.path): spec for spec in specs if spec.path}
    folders = {os.path.dirname(path) for path in published}
    found, faults = [], []
    for name, module in known(__name__, "reads").items():
        for reading in module.reads(root):
            place = f"consumer {name}"
            spec = published.get(os.path.realpath(reading.path))
            if spec is not None:
                found.append(f"{name} reads {spec} as user {reading.user}{_after_a_fault(spec, reading)}")
                faults += [Fault(place, *wrong) for wrong in (*_unreadable(reading), *_unsafe(spec, reading))]
            elif reading.is_named and os.path.dirname(os.path.realpath(reading.path)) in folders:
                hint = "publish there, or correct its configuration"
                faults.append(Fault(place, f"reads {reading.path}, where nothing is published", hint))
    return found, faults


def _after_a_fault(spec: Spec, reading: Reading) -> str:
    if reading.acts_from_millidegC is None:
        return ""
    poison = getattr(spec.options, "poison_millidegC", None)
    return f"; acts from {reading.acts_from_millidegC} on; after a fault it finds {poison or 'no file'}"


def _unsafe(spec: Spec, reading: Reading) -> list[tuple[str, str]]:
    """What it would do after a fault that it must not: problem and hint."""
    if reading.acts_from_millidegC is None:
        return []
    poison = getattr(spec.options, "poison_millidegC", None)
    shut_down = reading.shuts_down_from_millidegC
    hint = f"give {spec} a poison_millidegC of at least {reading.acts_from_millidegC}, and 'at_exit: poison'"
    if poison is None:
        return [(f"{reading.missing} while there is no value to be trusted", hint)]
    if poison < reading.acts_from_millidegC:
        return [(f"does not act on {poison}, which it reads after a fault", hint)]
    if shut_down is not None and poison >= shut_down:
        return [(f"shuts the device down at {poison}, which it reads after a fault", f"stay below {shut_down}")]
    if spec.options.at_exit != "poison":
        return [(f"{reading.missing} when the daemon has ended", hint)]
    return []


def _unreadable(reading: Reading) -> list[tuple[str, str]]:
    """Why its account may not read the file, as far as it and its folders are there: problem and hint."""
    try:
        user = pwd.getpwnam(reading.user)
    except KeyError:
        return []
    groups = os.getgrouplist(reading.user, user.pw_gid)
    path = os.path.realpath(reading.path)
    parts = [path]
    while (parent := os.path.dirname(parts[-1])) != parts[-1]:
        parts.append(parent)
    for part in reversed(parts):
        try:
            about = os.stat(part)
        except OSError:
            return []
        wanted = 0o1 if stat.S_ISDIR(about.st_mode) else 0o4
        shift = 6 if about.st_uid == user.pw_uid else 3 if about.st_gid in groups else 0
        if user.pw_uid != 0 and not about.st_mode >> shift & wanted:
            return [(f"runs as user {reading.user}, which {part} is closed to", "open it, or set 'access:'")]
    return []
