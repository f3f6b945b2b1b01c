"""What a robust test says, in a sentence that an engineer understands."""

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


def subject(result: Dependence) -> str:
    """The sensor, or the sensor and the signal."""
    return f"{result.sensor}, {result.driver}" if result.driver else result.sensor


def sentence(result: Dependence, significant: bool, grid: Grid) -> str:
    """What ``result`` says."""
    if result.test == "drift":
        return _drift(result, significant, grid)
    if result.test in ("change", "change of heat"):
        return _change(result, significant, grid)
    what = result.driver or _ALONG[result.test]
    if not significant:
        return f"{result.sensor}: the residual does not follow {what} more than chance would."
    delay_s = result.delay_steps * grid.step_s
    delay = f" with a delay of about {duration(delay_s)}" if delay_s else " at once"
    return (
        f"{result.sensor}: the residual follows {what}{delay}, by {digits(result.size, 2)} degC over its range"
        f"{_HINT[result.test]}."
    )


def _drift(result: Dependence, significant: bool, grid: Grid) -> str:
    if not significant:
        return f"{result.sensor}: the residual does not drift more than its memory explains."
    span = duration(grid.samples * grid.step_s)
    return f"{result.sensor}: the residual drifts by {digits(result.size, 2)} degC over {span}."


def _change(result: Dependence, significant: bool, grid: Grid) -> str:
    what = "the residual" if result.test == "change" else "the heat that explains the residual"
    if not significant or not result.turns:
        return f"{result.sensor}: {what} keeps its level."
    times = " and ".join(clock(grid.time_s[turn]) for turn in result.turns)
    how = "rises" if result.size > 0 else "falls"
    unit = f" by {digits(abs(result.size), 2)} degC" if result.test == "change" else ""
    turns = (
        f"{how}{unit} at about {times}" if len(result.turns) == 1 else f"{how}{unit} and comes back, at about {times}"
    )
    return f"{result.sensor}: {what} {turns}."
