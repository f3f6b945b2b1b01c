"""A scenario is data: steps of chamber and device, which `simulate` computes and `collect` runs in the laboratory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat

from ambient_model.faults import Fault
from ambient_trainer.data.strict_yaml import Strict, load_yaml, shipped_path, validated

FOLDER = Path(__file__).with_name("scenarios")

_Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]*$")]


class Settle(Strict):
    """Settled: no zone moves by ``drift_K`` for ``for_min``, the ambient within ``within_K`` of the set point.

    Without a chamber it stays that near to where it was.
    """

    within_K: PositiveFloat
    drift_K: PositiveFloat | None = None
    for_min: PositiveFloat
    at_most_min: PositiveFloat = 240.0
    """After this the program continues unsettled, and reports it."""

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if self.for_min > self.at_most_min:
            yield "'for_min' is longer than 'at_most_min'", "it could never settle: swap them"


class ScenarioStep(Strict):
    """What chamber and device do for a while, until all is settled, or until both is true."""

    chamber_degC: Annotated[float, Field(ge=-100, le=250)] | None = None
    """A change of the set point takes its time within the step that asks for it; None where there is no chamber."""
    gradient_K_min: Annotated[float, Field(ge=0.1, le=99.9)] | None = None
    """How fast the set point may move; else as fast as the chamber can."""
    duration_min: PositiveFloat | None = None
    settle: Settle | None = None
    load: tuple[_Name, ...] = ()
    """What the device does as long as the step lasts; nothing: it idles."""

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if self.duration_min is None and self.settle is None:
            yield "the step never ends", "give it 'duration_min', 'settle', or both"
        if self.gradient_K_min is not None and self.chamber_degC is None:
            yield "a gradient without a set point", "add 'chamber_degC', or remove the gradient"


class Scenario(Strict):
    """The steps one after the other."""

    format: Literal["ambient-campaign"] = "ambient-campaign"
    version: Literal[1] = 1
    about: str
    period_s: PositiveFloat = 1.0
    """Of the rows that the laboratory writes."""
    laboratory: Any = None
    """Where `collect` runs it; the simulation does not read it."""
    before: tuple[ScenarioStep, ...] = ()
    """What comes before the recording, which begins with ``steps``."""
    steps: Annotated[tuple[ScenarioStep, ...], Field(min_length=1)]

    @property
    def program(self) -> tuple[ScenarioStep, ...]:
        """All steps."""
        return (*self.before, *self.steps)

    @property
    def duration_s(self) -> float:
        """The length of the recording."""
        return sum(60.0 * (step.duration_min or 0.0) for step in self.steps)

    @property
    def before_s(self) -> float:
        """The length of what comes before it."""
        return sum(60.0 * (step.duration_min or 0.0) for step in self.before)


def scenario_names() -> tuple[str, ...]:
    """The names of the thesis's scenarios, which are a phone's, in its order."""
    return tuple(name for name in _shipped() if name[0].isdigit())


def scenario_path(name: str) -> str:
    """The file of the shipped scenario of that name, or ``name`` itself where it is a file's; else ``Refused``."""
    return shipped_path("scenario", name, FOLDER, _shipped())


def _shipped() -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in FOLDER.glob("*.yaml") if path.stem != "laboratory"))


def load_scenario(name: str) -> Scenario:
    """The shipped scenario of that name, or the one in a YAML file, to be simulated; a campaign is one, too.

    Each of its steps has a duration and at most one load. Raises :class:`Refused` with every fault in the file.
    """
    path = scenario_path(name)
    data = load_yaml(path)
    faults = []
    for part in ("before", "steps"):
        steps = data.get(part) if isinstance(data, dict) else None
        for index, step in enumerate(steps if isinstance(steps, list) else ()):
            if isinstance(step, dict) and step.get("settle") and "duration_min" not in step:
                hint = "add how long it takes: the simulation does not wait until all is settled"
                faults.append(Fault(f"{part}[{index}].duration_min", "missing", hint))
            if isinstance(step, dict) and step.get("chamber_degC") is None:
                faults.append(Fault(f"{part}[{index}].chamber_degC", "missing", "add it: the simulation has a chamber"))
            if isinstance(step, dict) and isinstance(load := step.get("load"), list) and len(load) > 1:
                faults.append(Fault(f"{part}[{index}].load", "more than one", "the simulation does one at a time"))
    return validated(Scenario, data, name, faults)
