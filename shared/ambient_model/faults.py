"""Faults of a file, all in one message, each with its place, the problem and a hint."""

from typing import NamedTuple


class Fault(NamedTuple):
    """One thing wrong in one place."""

    place: str
    """Where: ``line 17, column usb_degC`` or ``discrete[0].A``; empty for the file as a whole."""
    problem: str
    """What is wrong there."""
    hint: str
    """What to do."""

    def __str__(self) -> str:
        where = f"{self.place}: " if self.place else ""
        return f"{where}{self.problem}; {self.hint}"


class Refused(Exception):
    """A file or a call that cannot be taken, with every fault found in it."""

    def __init__(self, source: str, faults: list[Fault]) -> None:
        self.source = source
        self.faults = tuple(faults)
        super().__init__(source, faults)

    def __str__(self) -> str:
        if len(self.faults) == 1:
            return f"{self.source}: {self.faults[0]}"
        return "\n".join([f"{self.source}: {len(self.faults)} faults", *(f"  {fault}" for fault in self.faults)])


def refuse(source: str, place: str, problem: str, hint: str) -> Refused:
    """A refusal with a single fault, ready to be raised."""
    return Refused(source, [Fault(place, problem, hint)])
