"""What a bare circuit lacks, on measured sets: named, and held against later time that no step has seen.

The bars are what a careful engineer gets by hand with a little room; the first 60 % are diagnosed, the rest is scored.
"""

import json
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from ambient_trainer.cli.main import main


class Missing(NamedTuple):
    """A cause, the place, and what its driver is made of; None where nothing logged drives it."""

    cause: str
    place: str
    driver: str | None = None


class Case(NamedTuple):
    trace: str
    circuit: str
    later_s: float
    missing: tuple[Missing, ...]
    bar_degC: float


CASES = {
    "boiler": Case(
        "boiler", "house-boiler", 1_710_000,
        (Missing("heat_source", "indoor", "heating_power_kW"), Missing("thermal_mass", "indoor")), 1.0,
    ),
    "30q": Case("30q", "samsung30q-hppc", 29_527, (Missing("heat_source", "cell", "current_A"),), 0.42),
}  # fmt: skip
INSTRUMENT = ("sensor_", "clock_offset")


@pytest.fixture(scope="session")
def diagnosed(measured, circuit, tmp_path_factory):
    """The JSON of a case, diagnosed once a session."""
    folder = tmp_path_factory.mktemp("missing")

    def of(name: str) -> dict:
        path, case = folder / f"{name}.json", CASES[name]
        if not path.exists():
            arguments = ["diagnose", measured(case.trace), "--circuit", circuit(case.circuit)]
            arguments += ["--later", str(case.later_s), "--json", str(path)]
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sys, "argv", ["ambient-trainer", *arguments])
                with pytest.raises(SystemExit) as stopped:
                    main()
            assert stopped.value.code == 0
        return json.loads(Path(path).read_text(encoding="utf-8"))

    return of


def names(step: dict, missing: Missing) -> bool:
    """Whether the step is the cause at that place, driven so."""
    places = step["location"] if isinstance(step["location"], list) else [step["location"]]
    driven = missing.driver in (step["signal"] or "") if missing.driver else step["signal"] is None
    return step["cause"] == missing.cause and missing.place in places and driven


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_cause_is_named_and_later_time_simulated(diagnosed, name):
    found, case = diagnosed(name), CASES[name]
    steps = found["steps"]
    assert names(steps[0], case.missing[0])
    assert all(any(names(step, each) for step in steps) for each in case.missing)
    assert [step["cause"] for step in steps if step["cause"].startswith(INSTRUMENT)] == []
    assert found["later"]["extended_rmse_degC"] <= case.bar_degC
