"""A circuit of two nodes, trained by an hour and a half: enough for the machinery, and quick."""

import pytest

from ambient_studies.discovery.cases import Case, baselines
from ambient_studies.discovery.runner import teach
from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.simulator.effects.effect import Hidden

SCENARIO = "3"
CIRCUIT = """
format: ambient-circuit
version: 1
name: tiny
about: Connector and display
form: temperature
nodes:
  usb: {capacitance: 3, sensor: usb}
  display: {capacitance: C_display, sensor: display}
  ambient: {sensor: ambient}
edges:
  - {between: [usb, display], resistance: R_usb}
  - {between: [display, ambient], resistance: R_display}
sources:
  - {into: display, signal: soc_power_W, share: k}
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
        patch.setattr("ambient_studies.discovery.runner.known_good_model", lambda trained, normal: trained.model)
        return teach(parse_circuit(CIRCUIT, "tiny.yaml"), baselines(1, (SCENARIO, SCENARIO)))


@pytest.fixture(scope="session")
def cases():
    """Nothing, and a bias that nobody could miss."""
    biased = Hidden("sensor_bias", "display", None, 1500.0, None, 4.0)
    return (Case(0, 11, (), ("wifi_on",), SCENARIO), Case(1, 12, (biased,), (), SCENARIO))
