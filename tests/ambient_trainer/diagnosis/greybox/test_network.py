"""Networks against scipy's integrator, mechanisms through a file, and a mechanism as a file of its own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.circuits.circuit import Addition
from ambient_trainer.circuits.schema import load_circuit, parse_circuit
from ambient_trainer.circuits.write import write_circuit
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox import mechanisms, regression
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.file import addition_of, extended_circuit, greybox_of, kinds
from ambient_trainer.diagnosis.greybox.mechanisms.contact import Contact
from ambient_trainer.diagnosis.greybox.mechanisms.coupling import Coupling, ZoneLoss
from ambient_trainer.diagnosis.greybox.mechanisms.exponent import ChangedExponent, Exponent
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat, HeatInTheCold
from ambient_trainer.diagnosis.greybox.mechanisms.latent import Latent
from ambient_trainer.diagnosis.greybox.mechanisms.mass import HiddenMass
from ambient_trainer.diagnosis.greybox.mechanisms.path import Path
from ambient_trainer.diagnosis.greybox.mechanisms.sensor import (
    Bias,
    Clock,
    Drift,
    Gain,
    Lag,
    ReferenceBias,
    ReferenceLag,
    Stuck,
)
from ambient_trainer.diagnosis.greybox.model import GreyBox, Number
from refusals import refused

from ...conftest import CIRCUITS


def number(value, log=False):
    return Number("n", "1", value, log=log)


WIND, SQUARED = Expression("wind_m_s"), Expression("current_A^2")
PLACE = ("board",)
MECHANISMS = {
    "Heat": Heat(PLACE, (number(0.5),), SQUARED),
    "HeatInTheCold": HeatInTheCold(PLACE, (number(0.5), Number("g", "1", 0.01)), SQUARED),
    "Coupling": Coupling(PLACE, (number(0.3),), WIND),
    "ZoneLoss": ZoneLoss(PLACE, (number(0.5),), Expression("ambient_degC > 22")),
    "Exponent": Exponent(PLACE, (number(0.25),), typical_degC=(5.0,)),
    "ChangedExponent": ChangedExponent(PLACE, (number(0.25), Number("same_at", "K", 8.0, log=True))),
    "HiddenMass": HiddenMass(PLACE, (number(0.3, True), Number("lag", "s", 900.0, log=True))),
    "Path": Path(("board-wall",), (number(0.2, True),), ends=("board", "wall")),
    "Latent": Latent(
        PLACE, (number(0.5, True), Number("lag", "s", 600.0, True), Number("f", "K", 3.0, True)), melting_degC=22.0
    ),
    "Contact": Contact(PLACE, (number(0.5, True), Number("body", "degC", 33.0)), None, 6000.0, 12000.0),
    "Bias": Bias(PLACE, (number(0.5),), None, 6000.0, None),
    "Gain": Gain(PLACE, (number(0.05),), middle_degC=25.0),
    "Drift": Drift(PLACE, (number(0.05),), begin_s=0.0),
    "Lag": Lag(PLACE, (number(40.0),)),
    "Stuck": Stuck(PLACE, (number(25.0),), None, 6000.0, 9000.0),
    "Clock": Clock((), (number(75.0),)),
    "ReferenceLag": ReferenceLag(("ambient",), (number(75.0),)),
    "ReferenceBias": ReferenceBias(("ambient",), (number(2.0),)),
}


def test_every_kind_of_mechanism_is_held_here():
    assert set(MECHANISMS) == set(kinds())


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_circuit_written_and_read_again_simulates_the_same(circuit, simulated, recorded, name):
    trace = simulated(1)
    trace.columns["wall_degC"] = trace.columns["ambient_degC"] + 3
    model = GreyBox.of(circuit).with_mechanism(MECHANISMS[name])
    again = parse_circuit(write_circuit(extended_circuit(circuit, model)), name)
    (given,) = recorded(trace)
    rows = {"ambient_degC": given.signals["ambient_degC"], **given.signals}
    taken = replace(given, inputs=np.array([rows[each] for each in again.inputs]))
    one, other = (each.network(record, each.z()[None]) for each, record in ((model, given), (greybox_of(again), taken)))
    start = np.full((1, len(one.nodes)), 21.0)
    assert np.abs(one.simulate(start) - other.simulate(start)).max() < 1e-9
    bare = GreyBox.of(circuit)
    assert np.abs(one.simulate(start) - bare.network(given, bare.z()[None]).simulate(start[:, :1])).max() > 0.01


@pytest.mark.parametrize("name", ["HiddenMass", "ZoneLoss"])
def test_lanes_that_are_simulated_in_parts_are_the_same(circuit, simulated, recorded, name, monkeypatch):
    (record,) = recorded(simulated(6))
    model = GreyBox.of(circuit).with_mechanism(MECHANISMS[name])
    z = model.z() + np.linspace(-0.2, 0.2, 5)[:, None]
    start = np.linspace(18.0, 30.0, 5)[:, None] + np.zeros(len(model.network(record, z).nodes))
    whole = regression.simulate(model, record, z, start)
    monkeypatch.setattr(regression, "_LARGE", 0)
    monkeypatch.setattr(regression, "_CACHED", 2 * record.simulated.samples * start.shape[1])
    np.testing.assert_array_equal(regression.simulate(model, record, z, start), whole)


def test_a_body_that_is_put_there_agrees_with_an_integrator(circuit, simulated, recorded):
    (record,) = recorded(simulated(4))
    onset_s = 12_000.0
    mass = HiddenMass(PLACE, (number(0.3, True), Number("lag", "s", 900.0, log=True)), None, onset_s)
    model = GreyBox.of(circuit).with_mechanism(mass)
    read = model.network(record, model.z()[None]).simulate(np.array([[21.0, 35.0]]))[0, 0]
    air = record.signals["ambient_degC"]

    def slope(now_s, degC):
        outside, on = np.interp(now_s, record.time_s, air), now_s > onset_s
        into_body = 0.3 * (degC[0] - degC[1]) * on
        # until then it hangs in the air
        aired = (outside - degC[1]) / 300.0 * (not on)
        return [(0.2 * (outside - degC[0]) - into_body) / 50.0, into_body / (0.3 * 900.0) + aired]

    assert np.sqrt(np.mean((read - integrated(slope, record, [21.0, 35.0])[0]) ** 2)) < 0.03


def integrated(slope, record, start_degC):
    span = record.time_s[0], record.time_s[-1]
    return solve_ivp(slope, span, start_degC, t_eval=record.time_s, max_step=5.0, rtol=1e-8, atol=1e-8).y


@pytest.mark.parametrize("order", [1, -1])
def test_changes_of_one_loss_multiply(circuit, simulated, recorded, order):
    (record,) = recorded(simulated(4))
    covered = Coupling(PLACE, (number(-0.5),), None, 6000.0, 12_000.0)
    model = replace(GreyBox.of(circuit), mechanisms=(MECHANISMS["Coupling"], covered, MECHANISMS["Exponent"])[::order])
    read = model.network(record, model.z()[None]).simulate(np.array([[35.0]]))[0, 0]

    def slope(now_s, degC):
        outside, wind = (np.interp(now_s, record.time_s, record.signals[each]) for each in ("ambient_degC", "wind_m_s"))
        covered = 1.0 - 0.5 * (6000.0 < now_s < 12_000.0)
        blown = 0.3 * wind + (abs(outside - degC[0]) / 5.0) ** 0.25
        return [0.2 * covered * blown * (outside - degC[0]) / 50.0]

    assert np.sqrt(np.mean((read - integrated(slope, record, [35.0])[0]) ** 2)) < 0.05


def test_a_loss_that_is_another_for_good_is_constant_in_every_lane(circuit, simulated, recorded):
    (record,) = recorded(simulated(4))
    model = GreyBox.of(circuit).with_mechanism(Coupling(PLACE, (number(0.337),)))
    assert not model.network(record, model.z() + np.linspace(0.0, 0.1, 9)[:, None]).nonlinear


ONE = {"n": {"unit": "1", "value": 0.1}}
ELSEWHERE = [replace(each, places=("kitchen",)) for name, each in MECHANISMS.items() if each.places and name != "Path"]
LOOSE = [replace(MECHANISMS["Path"], ends=ends) for ends in ((), PLACE, ("board", "wall", "board", "wall"))]


@pytest.mark.parametrize(
    ("addition", "named"),
    [
        (Addition("Magic", PLACE, None, None, None, ONE, {}), "Magic"),
        (Addition("Coupling", ("cellar",), "wind_m_s", None, None, ONE, {}), "mechanisms[0]"),
        (Addition("Bias", ("cellar",), None, None, None, ONE, {}), "mechanisms[0]"),
        (Addition("Contact", PLACE, None, None, None, ONE, {}), "mechanisms[0]"),
        (Addition("Exponent", PLACE, None, None, None, ONE, {"typical_degC": "warm"}), "mechanisms[0]"),
        (Addition("Heat", PLACE, None, None, None, ONE, {"colour": 1}), "colour"),
        (Addition("Heat", PLACE, "wind_m_s +", None, None, ONE, {}), "wind_m_s +"),
        *((addition_of(each), f"{type(each).__name__} cannot act") for each in (*ELSEWHERE, *LOOSE)),
    ],
)
def test_a_mechanism_that_cannot_act_is_refused(circuit, addition, named):
    assert named in str(refused(greybox_of, replace(circuit, mechanisms=(addition,))))


BOX = CIRCUITS / "box.yaml"
MECHANISM = """
from dataclasses import dataclass
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.model import Number

@dataclass(frozen=True)
class Arc(Heat):
    cause = "arc"

def candidates(scene):
    driver = Expression("sqrt(abs(battery_current_A))^3")
    for node in scene.nodes:
        yield Arc((node,), (Number(f"arc_{node}", "W", 0.0, scale=scene.conductance(node), low=0.0),), driver)
"""


def test_a_mechanism_is_one_file(boxed, plugged):
    plugged(mechanisms, "arc", MECHANISM)
    kinds.cache_clear()
    found = diagnose(load_circuit(str(BOX)), [boxed("current_squared", 2)], period_s=120.0)
    assert "Arc" in kinds()
    assert "arc" in [each.cause.name for each in found.ranking]
    kinds.cache_clear()
