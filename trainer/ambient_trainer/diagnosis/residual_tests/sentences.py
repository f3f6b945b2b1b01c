"""What a robust test says, in a sentence that an engineer understands."""

from __future__ import annotations

from ambient_trainer.diagnosis.residual_tests.dependence import Dependence
from ambient_trainer.diagnosis.residual_tests.grid import Grid
from ambient_trainer.diagnosis.words import clock, digits, duration

_ALONG = {
    "ambient difference": "the node's difference to the ambient",
    "ambient difference, curved": "the square of the node's difference to the ambient",
    "ambient rate": "the ambient's rate of change",
    "ambient rate, curved": "the square of the ambient's rate of change",
}
_HINT = {
    "cross-correlation": "",
    "ambient difference": ": a resistance may be wrong or have changed",
    "ambient difference, curved": ": the loss may not be proportional to the difference",
    "ambient rate": ": a mass or a delay may be missing",
    "ambient rate, curved": ": what is missing acts on fast changes only",
}


def subject(found: Dependence) -> str:
    """The sensor, or the sensor and the signal."""
    return f"{found.sensor}, {found.driver}" if found.driver else found.sensor


def sentence(found: Dependence, significant: bool, grid: Grid) -> str:
    """What ``found`` says."""
    if found.test == "drift":
        return _drift(found, significant, grid)
    if found.test in ("change", "change of heat"):
        return _change(found, significant, grid)
    what = found.driver or _ALONG[found.test]
    if not significant:
        return f"{found.sensor}: the residual does not follow {what} more than chance would."
    delay_s = found.delay_steps * grid.step_s
    delay = f" with a delay of about {duration(delay_s)}" if delay_s else " at once"
    return (
        f"{found.sensor}: the residual follows {what}{delay}, by {digits(found.size, 2)} degC over its range"
        f"{_HINT[found.test]}."
    )


def _drift(found: Dependence, significant: bool, grid: Grid) -> str:
    if not significant:
        return f"{found.sensor}: the residual does not drift more than its memory explains."
    span = duration(grid.samples * grid.step_s)
    return f"{found.sensor}: the residual drifts by {digits(found.size, 2)} degC over {span}."


def _change(found: Dependence, significant: bool, grid: Grid) -> str:
    what = "the residual" if found.test == "change" else "the heat that explains the residual"
    if not significant or not found.turns:
        return f"{found.sensor}: {what} keeps its level."
    times = " and ".join(clock(grid.time_s[turn]) for turn in found.turns)
    how = "rises" if found.size > 0 else "falls"
    unit = f" by {digits(abs(found.size), 2)} degC" if found.test == "change" else ""
    turns = (
        f"{how}{unit} at about {times}" if len(found.turns) == 1 else f"{how}{unit} and comes back, at about {times}"
    )
    return f"{found.sensor}: {what} {turns}."
