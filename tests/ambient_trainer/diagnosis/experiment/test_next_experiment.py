"""What is said to do, against closed forms and against both models simulated anew from the sentence alone."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ambient_trainer.diagnosis.candidate import Candidate
from ambient_trainer.diagnosis.causes import claim
from ambient_trainer.diagnosis.experiment import next_experiment
from ambient_trainer.diagnosis.experiment.difference import Difference
from ambient_trainer.diagnosis.experiment.plan import Switch
from ambient_trainer.diagnosis.experiment.proposal import LONGEST_S
from ambient_trainer.diagnosis.model import Effect
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.result import UNKNOWN, Cause, Gain, Step
from ambient_trainer.diagnosis.selection import Selection

NODES = ("chip", "board", "case")


def step(name: str) -> Step:
    return Step(Cause(name), None, None, None, 0.9, Gain(1, 0.5, (0.4, 0.6), 0.0), (), "", {}, np.zeros((1, 1)))


Chooses = Callable[..., Selection]
Makes = Callable[..., Effect]
STEP = (step("heat_source"),)


def seconds(text: str) -> float:
    sizes = {"h": 3600.0, "min": 60.0, "s": 1.0}
    return sum(float(count) * sizes[unit] for count, unit in re.findall(r"(\d+) (h|min|s)\b", text))


class Read:
    """A sentence taken apart: levels at rest, switches, the moment and the sensor to read, both predictions."""

    def __init__(self, sentence: str) -> None:
        done, _, look = sentence.partition(": ")
        begun, *then = re.split(r", then ", done)
        self.rest = {name: float(level) for name, level in re.findall(r"`(\w+)` at (-?[\d.]+)", begun)}
        self.switches: list[tuple[float, str, float]] = []
        self.again_s: float | None = None
        at_s = 0.0
        for part in re.split(r" and (?=\d|take|do)", then[0]) if then else []:
            delay = re.match(r"([\dhmins ]+) later ", part)
            at_s += seconds(delay[1]) if delay else 0.0
            moved = re.search(r"take `(\w+)` (?:from -?[\d.]+|back) to (-?[\d.]+)", part)
            if moved:
                self.switches.append((at_s, moved[1], float(moved[2])))
            else:
                assert "do again, on purpose" in part, part
                self.again_s = at_s
        read = re.match(
            r"(then|(?:after )[\dhmins ]+?) `(\w+)`(.*?) reads (.*) \(3 sigma is ([\d.]+) degC\)\."
            r"(?: It does not separate whether (.*)\.)?$",
            look,
        )
        assert read, sentence
        self.reading_s = None if read[1] == "then" else seconds(read[1])
        self.sensor, self.beside = read[2], bool(read[3])
        predicted = re.findall(r"(-?[\d.]+) degC if (.*?)(?:,(?: and)? (?=-?[\d.]+ degC if)|$)", read[4])
        self.values = tuple(float(value) for value, _ in predicted)
        self.claims = tuple(said for _, said in predicted)
        self.three_sigma = float(read[5])
        self.open = tuple(read[6].split(" or ")) if read[6] else ()


def chain_heat(T: np.ndarray, levels: dict[str, float]) -> np.ndarray:
    """Heat into chip, board and case in W."""
    a, b = (T[0] - T[1]) / 6.0, (T[1] - T[2]) / 4.0
    return np.array([levels["power_W"] - a, a - b, b - (T[2] - levels["ambient_degC"]) / 8.0])


CAPACITANCES = np.array([5.0, 30.0, 60.0])


class ByHand:
    """One explanation written out by hand: heat beside the chain's, bodies beside its nodes, errors of sensors."""

    def __init__(
        self,
        cause: Cause,
        values: tuple[float, ...],
        heat: Callable[[np.ndarray, dict[str, float], float], list[float]] = lambda T, u, body: [0.0, 0.0, 0.0],
        body: tuple[int, float] | None = None,
        error: Callable[[np.ndarray], np.ndarray] = lambda T: np.zeros(3),
        lag: tuple[int, float] | None = None,
        **window: float | None,
    ) -> None:
        self.cause, self.values, self.heat, self.body, self.error, self.lag = cause, values, heat, body, error, lag
        self.window = window

    def acts(self, plan: Read, moment_s: float) -> bool:
        """What was over stays over until it is done again; all else goes on."""
        return "end_s" not in self.window or (plan.again_s is not None and moment_s >= plan.again_s)

    def reads(self, plan: Read) -> tuple[float, float]:
        """What the sensor reads, and what of that is its own error."""
        levels = dict(plan.rest)

        def slope(t: float, y: np.ndarray) -> np.ndarray:
            T, body = y[:3], y[3]
            heat = chain_heat(T, levels) + acts * np.array(self.heat(T, levels, body))
            node, constant = self.body or self.lag or (0, 1.0)
            return np.array([*(heat / CAPACITANCES), (T[node] - body) / constant])

        acts = self.acts(plan, -1.0)
        y = np.full(4, levels["ambient_degC"])
        y = solve_ivp(slope, (0, 4e5), y, "LSODA", rtol=1e-10, atol=1e-10).y[:, -1]
        end_s = plan.reading_s or 0.0
        moments = sorted({0.0, end_s, plan.again_s or 0.0, *(at for at, _, _ in plan.switches)})
        for begin, end in pairwise(moments):
            levels.update({name: level for at, name, level in plan.switches if at == begin})
            acts = self.acts(plan, begin)
            y = solve_ivp(slope, (begin, end), y, "DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
        index = NODES.index(plan.sensor)
        error = y[3] - y[index] if self.lag and self.lag[0] == index else self.error(y[:3])[index]
        return y[index] + error, error


def one(index: int, value: float) -> list[float]:
    return [value if each == index else 0.0 for each in range(3)]


def rise(T: np.ndarray, levels: dict[str, float]) -> float:
    """Of the case over the ambient."""
    return float(T[2] - levels["ambient_degC"])


G = 1.0 / 8.0
CASES = {
    "heat_source": ByHand(
        Cause("heat_source", "board", "radio_on"), (0.4,), lambda T, u, body: one(1, 0.4 * u.get("radio_on", 0.0))
    ),
    "ambient_coupling": ByHand(
        Cause("ambient_coupling", None), (-0.4,), lambda T, u, body: one(2, 0.4 * G * rise(T, u))
    ),
    "contact": ByHand(
        Cause("contact", "case"), (0.1, 1.0), lambda T, u, body: one(2, 0.1 * (25.0 - T[2]) + 1.0),
        onset_s=3000.0, end_s=5000.0,
    ),
    "convection_law": ByHand(
        Cause("convection_law", None), (0.05, -0.2),
        lambda T, u, body: one(2, 0.2 * G * rise(T, u) - 0.05 * G * rise(T, u) * abs(rise(T, u))),
    ),
    "thermal_mass": ByHand(
        Cause("thermal_mass", "case"), (0.5,), lambda T, u, body: one(2, -0.5 * (T[2] - body)),
        body=(2, 500.0), shape=500.0,
    ),
    "path": ByHand(
        Cause("path", "chip-case"), (0.3,), lambda T, u, body: [0.3 * (T[2] - T[0]), 0.0, 0.3 * (T[0] - T[2])]
    ),
    "sensor_bias": ByHand(Cause("sensor_bias", "chip"), (2.0,), error=lambda T: np.array(one(0, 2.0))),
    "sensor_gain": ByHand(
        Cause("sensor_gain", "chip"), (0.2, 1.0), error=lambda T: np.array(one(0, 0.2 * (T[0] - 25.0) + 1.0))
    ),
    "sensor_lag": ByHand(Cause("sensor_lag", "board"), (1.0,), lag=(1, 600.0), shape=600.0),
    "sensor_stuck": ByHand(
        Cause("sensor_stuck", "chip"), (22.0, 1.0), error=lambda T: np.array(one(0, 22.0 - T[0])), onset_s=2000.0
    ),
}  # fmt: skip


@pytest.mark.parametrize(("first", "second"), [*zip(CASES, [*list(CASES)[1:], next(iter(CASES))]), ("contact", "path")])
def test_numbers_are_those_of_both_models_simulated_from_the_sentence(
    chain: Plant, chosen: Chooses, effect: Makes, first: str, second: str
) -> None:
    both = CASES[first], CASES[second]
    sentence = next_experiment(
        chosen(chain, 0.1, *(effect(chain, each.cause, each.values, **each.window) for each in both)), STEP
    )

    plan = Read(sentence)

    assert plan.claims == tuple(claim(each.cause) for each in both)
    for value, each in zip(plan.values, both):
        reading, error = each.reads(plan)
        assert value == pytest.approx(error if plan.beside else reading, abs=0.006)
    assert abs(plan.values[0] - plan.values[1]) >= plan.three_sigma - 0.011
    assert plan.three_sigma == pytest.approx(0.42 if plan.beside else 0.3)


TAU_S, R = 1000.0, 10.0


def test_the_moment_is_when_a_rise_known_in_closed_form_passes_three_sigma(
    single: Plant, chosen: Chooses, effect: Makes
) -> None:
    """0.5 W through 10 K/W at 1000 s: 5 K (1 - exp(-t/tau)) passes 3 sigma of 1.2 degC."""
    found = chosen(single, 1.2, effect(single, Cause("heat_source", "board", "radio_on"), (0.5,)), taken=False)
    sentence = next_experiment(found, ())
    minute_s = 60 * np.ceil(-TAU_S * np.log(1 - 3.6 / 5.0) / 60)
    assert "heat_source at board by radio_on: " in sentence
    plan = Read(sentence.split("radio_on: ", 1)[1])
    assert plan.rest == {"ambient_degC": 20.0, "power_W": 0.0, "radio_on": 0.0}
    assert plan.switches == [(0.0, "radio_on", 1.0)]
    assert (plan.reading_s, plan.sensor, plan.three_sigma) == (minute_s, "board", 3.6)
    assert plan.values == pytest.approx((20 + 5 * (1 - np.exp(-minute_s / TAU_S)), 20.0), abs=0.006)
    assert plan.claims == ("a source heats `board` with `radio_on`", "nothing is missing")


@pytest.mark.parametrize("change", [-0.5, 0.8])
def test_crossing_is_analytic_where_two_time_constants_differ(
    single: Plant, effect: Makes, differing: Callable[..., Difference], change: float
) -> None:
    """Both rest at the room's temperature; under P they rise to P R / (1 + g) at tau / (1 + g)."""
    sigma = 0.8
    found = differing(single, sigma, effect(single, Cause("ambient_coupling"), (change,)), None)

    def apart(t: float) -> float:
        rise = 2.0 * R / (1 + change) * -np.expm1(-t * (1 + change) / TAU_S)
        return abs(rise - 2.0 * R * -np.expm1(-t / TAU_S)) - 3 * sigma

    assert [(each.column, each.level) for each in found.plan.switches] == [("power_W", 2.0)]
    assert found.crossing_s == pytest.approx(brentq(apart, 1.0, 3000.0, xtol=1e-9), abs=0.3)


def test_an_experiment_that_a_wrong_clock_moves_is_timed_by_the_reference(
    single: Plant, effect: Makes, differing: Callable[..., Difference]
) -> None:
    """The reference logs 900 s too late: the board moves first, and 3 sigma of a step's 10 K pass before it shows."""
    found = differing(single, 1.0, effect(single, Cause("clock_offset"), (1.0,), shape=900.0), None)

    assert [(each.column, abs(each.level - 20.0)) for each in found.plan.switches] == [("ambient_degC", 10.0)]
    assert found.crossing_s == pytest.approx(-900.0 - TAU_S * np.log(1 - 3.0 / 10.0), abs=21.0)


def test_a_bias_beside_heat_that_nothing_else_feels_takes_a_second_thermometer(
    single: Plant, chosen: Chooses, effect: Makes
) -> None:
    heat = effect(single, Cause("heat_source", "board"), (0.2,))
    bias = effect(single, Cause("sensor_bias", "board"), (0.2 * R,))
    plan = Read(next_experiment(chosen(single, 0.2, bias, heat), STEP))
    assert plan.beside
    assert (plan.reading_s, plan.switches, plan.values, plan.three_sigma) == (None, [], (2.0, 0.0), 0.85)


def test_explanations_that_predict_the_same_are_not_distinguished(
    single: Plant, chosen: Chooses, effect: Makes
) -> None:
    bias = effect(single, Cause("sensor_bias", "board"), (1.5,))
    gain = effect(single, Cause("sensor_gain", "board"), (0.0, 1.5))
    sentence = next_experiment(chosen(single, 0.01, bias, gain), STEP)
    assert sentence.startswith("No experiment of up to 4 h")
    assert all(claim(each.candidate.cause) in sentence for each in (bias, gain))
    assert "degC" not in sentence


def test_where_nothing_reaches_three_sigma_the_largest_difference_is_said(
    single: Plant, chosen: Chooses, effect: Makes
) -> None:
    """0.1 W more for the 4 h of the longest experiment: 1 K less what is still to come."""
    found = chosen(single, 0.5, effect(single, Cause("heat_source", "board", "radio_on"), (0.1,)), taken=False)

    sentence = next_experiment(found, ())

    rise = 1.0 - np.exp(-LONGEST_S / TAU_S)
    assert (
        f"by is about {0.98 * rise:.2f} degC on `board` (3 sigma is 1.5 degC), after 1 h 5 min 20 s: hold" in sentence
    )
    assert sentence.endswith("then take `radio_on` from 0 to 1.")


def test_what_happened_and_is_over_is_done_again(single: Plant, chosen: Chooses, effect: Makes) -> None:
    hand = effect(single, Cause("contact", "board"), (0.1, 1.0), 3600.0, 5400.0)
    source = effect(single, Cause("heat_source", "board"), (1.5,), 3600.0, 5400.0)

    sentence = next_experiment(chosen(single, 0.5, hand, source), STEP)

    assert "do again, on purpose, what happened from 1:00:00 to 1:30:00: after" in sentence
    plan = Read(sentence)
    assert plan.reading_s is not None
    assert plan.again_s == 0.0
    heat_W = 1.5 + sum(level for _, column, level in plan.switches if column == "power_W")
    # held, half the resistance and so half the time constant
    assert plan.values[0] == pytest.approx(20 + heat_W / 0.2 * -np.expm1(-2 * plan.reading_s / TAU_S), abs=0.006)
    assert plan.values[1] == pytest.approx(20 + heat_W / 0.1 * -np.expm1(-plan.reading_s / TAU_S), abs=0.006)


def test_what_goes_on_is_undone_where_nothing_simpler_distinguishes(
    single: Plant, chosen: Chooses, effect: Makes
) -> None:
    """At 0.5 degC the 2 degC are too little beside a second thermometer, and enough for the sensor itself."""
    source = effect(single, Cause("heat_source", "board"), (0.2,), 3600.0)
    bias = effect(single, Cause("sensor_bias", "board"), (2.0,), 3600.0)
    sentence = next_experiment(chosen(single, 0.5, source, bias), STEP)
    assert sentence.startswith("Undo what happened from 1:00:00 to the end and hold ")
    plan = Read(sentence)
    assert (plan.reading_s, plan.beside, plan.values, plan.three_sigma) == (None, False, (20.0, 22.0), 1.5)


@pytest.mark.parametrize("onset_s", [None, 3600.0])
def test_switching_goes_before_a_second_thermometer_and_before_undoing(
    single: Plant, chosen: Chooses, effect: Makes, onset_s: float | None
) -> None:
    """A hand of 26 degC and a bias read the same 22 degC at rest; either look would tell at once, but costs an hour."""
    hand = effect(single, Cause("contact", "board"), (0.05, 0.05), onset_s)
    bias = effect(single, Cause("sensor_bias", "board"), (2.0,), onset_s)

    plan = Read(next_experiment(chosen(single, 0.4, hand, bias), STEP))

    assert plan.switches == [(0.0, "power_W", 2.0)]
    assert plan.again_s is None
    assert not plan.beside
    assert plan.reading_s is not None
    assert plan.values[0] == pytest.approx(22 + 2.0 / 0.15 * -np.expm1(-1.5 * plan.reading_s / TAU_S), abs=0.006)
    assert plan.values[1] == pytest.approx(22 + 2.0 / 0.1 * -np.expm1(-plan.reading_s / TAU_S), abs=0.006)


def test_what_a_device_could_not_bear_is_not_proposed(
    single: Plant, effect: Makes, differing: Callable[..., Difference]
) -> None:
    """At 2 W the two differ by 6 degC when the board is at 35; no more than 30 are reached in a cold room."""
    coupling = effect(single, Cause("ambient_coupling"), (0.8,))

    free = differing(single, 2.0, coupling, None)
    bounded = differing(single, 2.0, coupling, None, hottest_degC=30.0)

    assert free.plan.switches == (Switch("power_W", 0.0, 2.0),)
    assert max(free.predicted_degC) > 30.0
    assert bounded.plan.switches == (Switch("power_W", 0.0, 2.0), Switch("ambient_degC", 0.0, 0.0))
    assert max(bounded.predicted_degC) < 30.0


def test_a_fault_that_is_over_is_waited_for(single: Plant, chosen: Chooses, effect: Makes) -> None:
    bias = effect(single, Cause("sensor_bias", "board"), (2.0,), 3600.0, 5400.0)
    sentence = next_experiment(chosen(single, 0.2, bias, taken=False), ())
    assert "Wait until it is as it was from 1:00:00 to 1:30:00" in sentence
    plan = Read(sentence.split("sensor_bias at board: ", 1)[1])
    assert (plan.reading_s, plan.values, plan.three_sigma) == (None, (22.0, 20.0), 0.6)


def test_a_drift_has_grown_by_the_time_of_the_experiment(single: Plant, chosen: Chooses, effect: Makes) -> None:
    """1 K/h since 1000 s, and the record ends at 7190 s."""
    drift = effect(single, Cause("sensor_drift", "board"), (1 / 3600,), 1000.0)

    plan = Read(next_experiment(chosen(single, 0.2, drift, taken=True), STEP))

    assert plan.reading_s is None
    assert plan.values == (pytest.approx(20 + 6190 / 3600, abs=0.012), 20.0)


def test_the_taken_cause_is_told_from_three_rivals_at_once(chain: Plant, chosen: Chooses, effect: Makes) -> None:
    """By models written out by hand."""
    names = ("convection_law", "thermal_mass", "sensor_gain", "path", "heat_source")
    effects = [effect(chain, CASES[name].cause, CASES[name].values, **CASES[name].window) for name in names]

    plan = Read(next_experiment(chosen(chain, 0.1, *effects), STEP))

    assert plan.claims == tuple(claim(CASES[name].cause) for name in names[:4])
    for value, name in zip(plan.values, names):
        reading, error = CASES[name].reads(plan)
        assert value == pytest.approx(error if plan.beside else reading, abs=0.006)
    assert min(abs(plan.values[0] - value) for value in plan.values[1:]) >= plan.three_sigma - 0.011
    assert plan.open == ()


def test_a_rival_that_predicts_the_same_is_said_to_be_left(single: Plant, chosen: Chooses, effect: Makes) -> None:
    bias, gain = Cause("sensor_bias", "board"), Cause("sensor_gain", "board")
    taken, same = effect(single, bias, (1.5,)), effect(single, gain, (0.0, 1.5))
    heat = effect(single, Cause("heat_source", "board", "radio_on"), (0.5,))

    plan = Read(next_experiment(chosen(single, 0.1, taken, same, heat), STEP))

    assert plan.claims == tuple(claim(each) for each in (bias, heat.candidate.cause))
    assert plan.open == tuple(claim(each) for each in (bias, gain))
    assert abs(plan.values[0] - plan.values[1]) >= plan.three_sigma


def test_several_that_predict_the_same_are_all_named(single: Plant, chosen: Chooses, effect: Makes) -> None:
    bias = effect(single, Cause("sensor_bias", "board"), (1.5,))
    gain = effect(single, Cause("sensor_gain", "board"), (0.0, 1.5))
    weak = effect(single, Cause("heat_source", "board", "radio_on"), (1e-9,))
    sentence = next_experiment(chosen(single, 1000.0, bias, gain, weak), STEP)
    assert sentence.startswith("No experiment of up to 4 h")
    assert all(claim(each.candidate.cause) in sentence for each in (bias, gain, weak))
    assert "about 1.5 degC on `board`" in sentence


def test_a_rival_of_the_same_cause_is_none(single: Plant, chosen: Chooses, effect: Makes) -> None:
    """The sentence could not say which is which."""
    heat, later = (effect(single, Cause("heat_source", "board"), (0.2,), onset) for onset in (1000.0, 2000.0))
    bias = effect(single, Cause("sensor_bias", "board"), (3.0,))

    plan = Read(next_experiment(chosen(single, 0.1, heat, later, bias), STEP))

    assert plan.claims == tuple(claim(each.candidate.cause) for each in (heat, bias))


def test_of_several_rivals_and_candidates_the_closest_is_asked_about(
    single: Plant, chosen: Chooses, effect: Makes
) -> None:
    effects = [effect(single, Cause("heat_source", "board", signal), (0.5,)) for signal in ("power_W", "radio_on")]
    effects.append(effect(single, Cause("sensor_bias", "board"), (3.0,)))

    rivals, candidates = (
        Read(next_experiment(chosen(single, 0.1, *effects, rivals=rivals), STEP)) for rivals in (True, False)
    )

    assert rivals.claims[1:] == ("a source heats `board` with `radio_on`", "`board` reads with a bias")
    assert candidates.claims[1:] == rivals.claims[1:2]


def test_the_last_step_that_has_rivals_is_asked_about(single: Plant, chosen: Chooses, effect: Makes) -> None:
    heat = effect(single, Cause("heat_source", "board", "radio_on"), (0.5,))
    coupling = effect(single, Cause("ambient_coupling"), (0.5,))
    bias, late = (
        effect(single, Cause("sensor_bias", "board"), (3.0,)),
        effect(single, Cause("sensor_lag", "board"), (1,)),
    )
    first = chosen(single, 0.1, heat, coupling)
    second = chosen(single, 0.1, bias, late)

    found = replace(second, steps=(*first.steps, *second.steps))
    none_last = replace(second, steps=(*first.steps, *chosen(single, 0.1, bias, rivals=False).steps))

    assert Read(next_experiment(found, STEP * 2)).claims == ("`board` reads with a bias", "`board` reads late")
    assert Read(next_experiment(none_last, STEP * 2)).claims == tuple(
        claim(each.candidate.cause) for each in (heat, coupling)
    )


def test_unknown_asks_for_a_survey_of_every_drive(single: Plant, chosen: Chooses) -> None:
    sentence = next_experiment(chosen(single, 0.1), (step(UNKNOWN),))
    for fact in ("`power_W` at 0 W", "for 50 min each", "`power_W` from 0 to 2 W", "`radio_on` from 0 to 1",
                 "`ambient_degC` from 20 to 30 degC", "at `board`"):  # fmt: skip
        assert fact in sentence


def test_nothing_to_rule_out_is_said(single: Plant, chosen: Chooses) -> None:
    assert next_experiment(chosen(single, 0.1), ()) == "Nothing is missing, and no candidate is left to rule out."


def test_every_cause_that_can_be_found_can_be_claimed(
    chain: Plant, candidates: Callable[[Plant], list[Candidate]]
) -> None:
    causes = {each.cause for each in candidates(chain)}

    claims = {claim(each) for each in causes}

    assert len(claims) == len(causes)
    assert {each.name for each in causes} == {*CASES, "sensor_drift", "clock_offset"}
