"""The causes, a module each: one in this folder, or an entry point of this package's name, that defines ``KIND``."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Setting
from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Cause

_NO_CAUSE = {
    UNKNOWN: ("a misfit that no known cause explains", "something that was not tried is missing"),
    NONE: ("nothing", "nothing is missing"),
    "latent_heat": ("a body that freezes or melts", "a body at {place} changes its phase"),
    "transport_delay": ("a delay on the way", "what reaches {place} comes later"),
}


@cache
def cause_kinds() -> dict[str, CauseKind]:
    """Every kind of cause by name, the simplest first."""
    kinds: list[CauseKind] = [plugin(__name__, name).KIND for name in plugin_names(__name__)]
    return {each.name: each for each in sorted(kinds, key=lambda each: (each.rank, each.name))}


def kind_of(cause: Cause) -> CauseKind:
    """The kind of a cause; raises ``KeyError`` for ``none`` and ``unknown``."""
    return cause_kinds()[cause.name]


def all_candidates(setting: Setting) -> Iterator[Candidate]:
    """Every cause at every place that the circuit has, by every signal that was logged."""
    for kind in cause_kinds().values():
        yield from kind.candidates(setting)


def noun(cause: Cause) -> str:
    """``cause`` as a noun: ``heat that the circuit lacks, at flash, driven by camera_on``."""
    words = _words(cause)[0]
    if cause.location is not None:
        place = str(cause.place)
        words += f", {'between' if '-' in place else 'at'} {place.replace('-', ' and ')}"
    return words + ("" if cause.signal is None else f", driven by {cause.signal}")


def claim(cause: Cause) -> str:
    """What ``cause`` says of the device, as a clause."""
    clause = _words(cause)[1]
    place = "all nodes" if cause.location is None else " and ".join(f"`{each}`" for each in str(cause.place).split("-"))
    return clause.format(place=place) + ("" if cause.signal is None else f" with `{cause.signal}`")


def _words(cause: Cause) -> tuple[str, str]:
    """A cause as a noun and as a claim; one that a plug-in brings stands for itself."""
    if cause.name in cause_kinds():
        return kind_of(cause).noun, kind_of(cause).claim
    name = cause.name.replace("_", " ")
    return _NO_CAUSE.get(cause.name, (name, f"{name} at {{place}}"))
