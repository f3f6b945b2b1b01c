"""A circuit of two nodes, trained by an hour and a half: enough for the machinery, and quick."""

import numpy as np
import pytest

from ambient_studies.discovery.cases import Case, baselines
from ambient_studies.discovery.figures import Outcome
from ambient_studies.discovery.runner import train
from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.simulator.hidden import Hidden

SCENARIO = "3"
CIRCUIT = """
format: ambient-circuit
version: 1
name: tiny
about: Connector and display
form: temperature
nodes:
  {usb: {capacitance: 3, sensor: usb}, display: {capacitance: C_display, sensor: display}, ambient: {sensor: ambient}}
edges: [{between: [usb, display], resistance: R_usb}, {between: [display, ambient], resistance: R_display}]
sources: [{into: display, signal: soc_power_W, share: k}]
outputs: sensors
parameters:
  C_display: {unit: J/K, initial: 60, min: 10, max: 300}
  R_usb: {unit: K/W, initial: 30, min: 3, max: 300}
  R_display: {unit: K/W, initial: 5, min: 0.5, max: 50}
  k: {unit: "1", initial: 0.5, min: 0, max: 2}
"""


@pytest.fixture(scope="session")
def bench():
    with pytest.MonkeyPatch.context() as patch:
        # what a circuit lacks besides is found by the search, which has tests of its own, and takes long
        patch.setattr("ambient_trainer.diagnosis.known_good.permanent_candidates", lambda context, columns_of: iter(()))
        return train(parse_circuit(CIRCUIT, "tiny.yaml"), baselines(1, scenarios=(SCENARIO, SCENARIO)))


@pytest.fixture(scope="session")
def cases():
    """Nothing, and a bias that nobody could miss."""
    biased = Hidden("sensor_bias", "display", None, 1500.0, None, 4.0)
    return (Case(0, 11, (), ("wifi_on",), SCENARIO), Case(1, 12, (biased,), (), SCENARIO))


CAMERA, CASE = Cause("heat_source", "flash", "camera_on"), Cause("ambient_coupling", "battery")


def synthetic_outcomes() -> list[Outcome]:
    """A benchmark of 400 cases."""
    random = np.random.default_rng(4)
    causes = [CAMERA, CASE, Cause("contact"), Cause("sensor_bias", "usb"), Cause("clock_offset"), Cause("path", "a-b")]
    outcomes = []
    for _ in range(300):
        cause, size = causes[random.integers(len(causes))], float(np.exp(random.uniform(-1.5, 3.5)))
        right = bool(random.random() < 1 / (1 + (1.5 / size) ** 2))
        wrong = () if random.random() < 0.6 else (causes[random.integers(len(causes))],)
        found = (cause,) if right else wrong
        sure = float(random.beta(8, 1) if right else random.beta(2, 2))
        outcomes.append(
            Outcome((cause,), size, found, found == (cause,), 0.1 if right else None, 20.0 if right else None,
                    (0.01, 0.2) if found else None, 4.0, (sure,) * len(found))
        )  # fmt: skip
    outcomes += [Outcome((), 0.0, (), True, None, None, None, 2.0)] * 58
    outcomes += [Outcome((), 0.0, (Cause("unknown"),), False, None, None, (0.001, 0.1), 3.0)] * 2
    outcomes += [Outcome((CAMERA, CASE), 6.0, (CASE, CAMERA), True, 0.05, 10.0, (0.1, 0.2), 8.0)] * 30
    outcomes += [Outcome((CAMERA, CASE), 6.0, (CASE,), False, 0.05, 10.0, (0.1, 0.2), 8.0)] * 10
    return outcomes
