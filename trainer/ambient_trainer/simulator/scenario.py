"""A scenario is data: steps of the thesis's section 3.2, each with a duration, a chamber set point and an activity."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from ambient_model.faults import refuse
from ambient_trainer.data.strict_yaml import Strict, parse_yaml, validated
from ambient_trainer.simulator.constants import Activity

_FOLDER = Path(__file__).with_name("scenarios")


class Step(Strict):
    """What the chamber is set to and the phone does for a while."""

    duration_min: Annotated[float, Field(gt=0)]
    chamber_degC: Annotated[float, Field(ge=-40, le=130)]
    activity: Activity


class Scenario(Strict):
    """The steps one after the other; a change of the set point takes its time within the step that asks for it."""

    about: str
    before: tuple[Step, ...] = ()
    """What phone and chamber went through before the recording, which begins with ``steps``."""
    steps: Annotated[tuple[Step, ...], Field(min_length=1)]

    @property
    def duration_s(self) -> float:
        """The length of the recording."""
        return 60.0 * sum(step.duration_min for step in self.steps)

    @property
    def before_s(self) -> float:
        """The length of what came before it."""
        return 60.0 * sum(step.duration_min for step in self.before)


def scenario_names() -> tuple[str, ...]:
    """The names of the shipped scenarios, in the thesis's order."""
    files = (entry.name for entry in _FOLDER.iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml")))


def load_scenario(name: str) -> Scenario:
    """The shipped scenario of that name; raises :class:`~ambient_model.faults.Refused` for an unknown one."""
    if name not in scenario_names():
        raise refuse("scenario", "", f"none is called {name!r}", f"take one of {', '.join(scenario_names())}")
    text = (_FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    return validated(Scenario, parse_yaml(text, name), name)
