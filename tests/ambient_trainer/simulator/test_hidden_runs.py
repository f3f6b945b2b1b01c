"""Runs with hidden effects: the trace keeps the secret, the truth tells it in a diagnosis's terms, sizes matter."""

import importlib
import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator.additions import Added, Term
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.hidden import PLUGINS, Hidden, Ran, checked, effects
from ambient_trainer.simulator.run import Driven, Run
from ambient_trainer.simulator.scenario import load_scenario
from ambient_trainer.simulator.simulate import simulate, simulate_many, truth
from ambient_trainer.simulator.text import choices, draw_hidden
from refusals import refused, refused_places

NODES = tuple(load_device().nodes)
_SCENARIO = "3"
_LASTS_S = load_scenario(_SCENARIO).duration_s
_PERIOD_S = 10.0
# each with the least and the largest magnitude that it has in a run, and the unit
_MAGNITUDES = {
    Hidden("heat_source", "board2", None, 1500.0, 3600.0, 0.5): (0.35, 0.55, "W"),
    Hidden("heat_source", "soc", "radio_on", 0.0, None, 0.3): (0.21, 0.33, "W"),
    Hidden("heat_source", "display", "irradiance_W_m2", 0.0, None, 1.0): (0.85 / 800, 1 / 800, "W per W/m2"),
    # of a resistance at 25 degC, in a phone that is warmer
    Hidden("heat_source", "usb", "accessory_current_A", 0.0, None, 0.2): (0.14, 0.26, "W/A^2"),
    Hidden("ambient_coupling", None, None, 1500.0, None, 1.0): (0.6, 1.0, "1"),
    Hidden("ambient_coupling", None, "fan_on", 0.0, None, -0.5): (-0.6, -0.3, "1"),
    Hidden("ambient_coupling", "display", "wind_m_s", 0.0, None, -0.6): (-0.45, -0.2, "1 per m/s"),
    Hidden("contact", "back", None, 1500.0, 3600.0, 0.1): (25.0, 37.0, "degC"),
    Hidden("convection_law", None, None, 0.0, None, 2.0): (0.2, 0.7, "1"),
    Hidden("thermal_mass", "display", None, 1500.0, None, 100.0): (100.0, 100.0, "J/K"),
    Hidden("path", "flash-usb", None, 1500.0, None, 0.1): (0.08, 0.1, "W/K"),
    Hidden("sensor_bias", "usb", None, 1500.0, None, -2.0): (-2.0, -1.95, "degC"),
    Hidden("sensor_gain", "flash", None, 1500.0, None, 0.1): (0.1, 0.1, "1"),
    Hidden("sensor_lag", "display", None, 1500.0, None, 150.0): (150.0, 150.0, "s"),
    Hidden("sensor_stuck", "usb", None, 1500.0, None, 30.0): (30.0, 30.0, "degC"),
    Hidden("sensor_drift", "battery", None, 1500.0, None, 0.8): (0.75, 0.9, "K/h"),
    Hidden("clock_offset", None, None, 0.0, None, 60.0): (59.5, 60.5, "s"),
}
_ONE_OF_EACH = list(_MAGNITUDES)


@pytest.fixture(scope="module")
def simulated():
    runs = [(_SCENARIO, 11, [effect]) for effect in _ONE_OF_EACH]
    return dict(zip(_ONE_OF_EACH, simulate_many(runs, _PERIOD_S, sizes=True)))


@pytest.fixture(scope="module")
def plain():
    return simulate(_SCENARIO, seed=11, period_s=_PERIOD_S).trace


def _same(one, other):
    return all(np.array_equal(one.columns[name], other.columns[name]) for name in other.columns)


def test_only_readings_after_its_onset_tell_and_the_twin_is_the_plain_run(simulated, plain):
    for effect, run in simulated.items():
        assert (run.trace.notes, run.trace.path) == (plain.notes, plain.path)
        assert list(run.trace.columns) == [*plain.columns, *([effect.signal] if effect.signal else [])]
        assert np.array_equal(run.trace.time_s, plain.time_s)
        assert _same(run.clean, plain)
        assert list(run.clean.columns) == list(run.trace.columns)
        before = plain.time_s < effect.onset_s
        for name in plain.columns:
            changed = run.trace.columns[name] != plain.columns[name]
            assert not changed[before].any()
            if effect.cause.startswith("sensor_"):
                assert changed.any() == (name == f"{effect.location}_degC")
            if effect.cause == "clock_offset":
                assert changed.any() == (name == "ambient_degC")


@pytest.mark.parametrize("effect", _ONE_OF_EACH, ids=lambda each: f"{each.cause}-{each.location}-{each.signal}")
def test_the_truth_names_it_and_its_magnitude(simulated, effect):
    run = simulated[effect]
    (told,) = run.truths
    assert (told.cause, told.location, told.signal) == (effect.cause, effect.location, effect.signal)
    assert told.end_s == effect.end_s
    if effect.signal is None:
        assert told.onset_s == (effect.onset_s or None)
    else:
        assert told.onset_s == run.trace.time_s[run.trace.columns[effect.signal] > 0][0]
    low, high, unit = _MAGNITUDES[effect]
    assert told.unit == unit
    assert low - 1e-9 <= told.magnitude <= high + 1e-9
    assert told.size_degC > 0.3
    assert json.loads(json.dumps(asdict(told), allow_nan=False))["cause"] == effect.cause


def test_the_truth_has_the_thesiss_names_and_the_size_at_the_worst_sensor(simulated):
    named = {effect.location: run.truths[0].sensor_location for effect, run in simulated.items()}
    assert (named["board2"], named["flash-usb"], named["back"]) == ("battery", "flash-usb", None)
    (told,) = simulated[_ONE_OF_EACH[11]].truths
    assert told.worst == "usb_degC"
    assert told.size_degC == pytest.approx(2.0, abs=0.05)
    (clock,) = simulated[_ONE_OF_EACH[-1]].truths
    assert clock.worst == "ambient_degC"


def _ran(hidden, loss, pattern):
    """An effect in a made-up run: nodes at a swinging difference to still air, ``loss`` the terms."""
    count = 500
    time_s = np.arange(count) * 10.0
    air_degC = np.full(count, 20.0)
    nodes_degC = 20.0 + np.repeat(np.linspace(-15.0, 25.0, count)[:, None], len(NODES), axis=1)
    phone = load_device().with_values({f"nodes.{node}.emissivity": 0.0 for node in NODES})
    run = Run(phone, 20.0, air_degC, np.zeros(count, dtype=int), np.ones(count), 0)
    driven = Driven(run, nodes_degC, np.zeros(count), np.zeros(count), np.empty((count, 0)))
    part = Added((Term(loss, np.ones(count), pattern),))
    trace = Trace("", time_s, {})
    return Ran(phone, time_s, 10.0, {}, hidden, lambda: np.random.default_rng(0), driven, part, part, trace)


def test_where_the_loss_scales_the_resistance_is_exact_and_the_exponent_the_same():
    hidden = Hidden("ambient_coupling", None, None, 0.0, None, 1.0)
    told = truth(_ran(hidden, "convected", np.full(len(NODES), -0.6)))
    assert told.magnitude == pytest.approx(1 / 0.4 - 1)
    assert told.others["conductance_change"][0] == pytest.approx(-0.6)
    hidden = Hidden("convection_law", None, None, 0.0, None, 1.0)
    assert truth(_ran(hidden, "convected", np.full(len(NODES), 0.7))).magnitude == pytest.approx(0.0, abs=1e-9)
    # a part that is linear makes the whole less bent than its 1.25
    assert -0.25 < truth(_ran(hidden, "blown", np.full(len(NODES), 1.0))).magnitude < -0.05
    assert truth(_ran(hidden, "draught", np.full(len(NODES), 1.0))).magnitude > 0.1


def test_effects_of_size_zero_leave_the_trace_as_it_is(plain):
    """But for the columns of signals; a sensor that sticks has a value, not a size."""
    effects = [replace(each, size=0.0) for each in _ONE_OF_EACH if each.cause != "sensor_stuck"]
    for run in simulate_many([(_SCENARIO, 11, [effect]) for effect in effects], _PERIOD_S):
        assert _same(run.trace, plain)


def test_several_effects_add_up_and_are_each_sized_alone(simulated):
    both = [_ONE_OF_EACH[0], _ONE_OF_EACH[11]]
    run = simulate_many([(_SCENARIO, 11, both)], _PERIOD_S, sizes=True)[0]
    assert [told.cause for told in run.truths] == ["heat_source", "sensor_bias"]
    for told, one in zip(run.truths, both):
        assert told.size_degC == simulated[one].truths[0].size_degC
    heat, bias = (simulated[each].trace.columns for each in both)
    assert np.array_equal(run.trace.columns["battery_degC"], heat["battery_degC"])
    sum_degC = heat["usb_degC"] + bias["usb_degC"] - run.clean.columns["usb_degC"]
    assert np.abs(run.trace.columns["usb_degC"] - sum_degC).max() < 0.21


def test_runs_of_unlike_length_are_what_each_is_alone():
    runs = [
        ("2.4", 4, [Hidden("thermal_mass", "board2", None, 300.0, None, 20.0)]),
        ("2.5", 5, [Hidden("path", "flash-usb", size=0.1)]),
    ]
    for run, together in zip(runs, simulate_many(runs, _PERIOD_S)):
        alone = simulate_many([run], _PERIOD_S)[0]
        assert _same(together.trace, alone.trace)
        assert [told.magnitude for told in together.truths] == pytest.approx([told.magnitude for told in alone.truths])


def test_decoys_change_nothing_and_stand_among_the_signals(simulated):
    effect = _ONE_OF_EACH[1]
    decoys = ("wifi_on", "light_lux", "radio_on", "gps_on")
    run = simulate_many([(_SCENARIO, 11, [effect])], _PERIOD_S, decoys)[0]
    assert list(run.trace.columns)[-4:] == sorted(decoys)
    assert _same(run.trace, simulated[effect].trace)
    assert not np.array_equal(run.trace.columns["wifi_on"], run.trace.columns["radio_on"])
    other = simulate_many([("2.1", 12, [effect])], _PERIOD_S)[0]
    assert not np.array_equal(other.trace.columns["radio_on"], run.trace.columns["radio_on"][:90])


def test_what_cannot_be_is_refused_with_every_fault_and_what_is_outside_the_run():
    phone = load_device()
    wrong = Hidden("heat_source", "moon", "fan_on", -1.0, -2.0, 99.0, "hand")
    assert refused_places(checked, wrong, phone) == ["location", "signal", "body", "size", "from", "to"]
    for cause, place in (("path", "usb-usb"), ("path", "usb"), ("sensor_bias", "frame"), ("contact", "soc")):
        assert refused_places(simulate, "2.1", hide=[Hidden(cause, place, size=0.1)]) == ["location"]
    assert "warmth" in str(refused(checked, Hidden("warmth"), phone))
    for size in (float("nan"), float("inf")):
        assert "0 to 2000 J/K" in str(refused(checked, Hidden("thermal_mass", "display", size=size), phone))
    late = Hidden("sensor_bias", "usb", None, 1e5, None, 1.0)
    long = Hidden("heat_source", "soc", "radio_on", 0.0, 1e6, 1.0)
    assert refused_places(simulate_many, [("1", 0, [late, long, replace(long, end_s=1000.0)])], decoys=["noise"]) == [
        *("effect 1 (sensor_bias), from", "effect 2 (heat_source), to", "effect 3 (heat_source), signal"),
        "decoy 'noise'",
    ]


@pytest.mark.slow
def test_what_is_drawn_at_scale_1_matters_and_halves_at_a_half():
    runs = []
    for number, cause in enumerate(effects()):
        for scale in (0.5, 1.0):
            effect = draw_hidden(np.random.default_rng(number), cause, load_scenario("5").duration_s, scale)
            runs.append(("5", 3, [effect]))
    told = [run.truths[0] for run in simulate_many(runs, 20.0, sizes=True)]
    for half, whole in zip(told[::2], told[1::2]):
        assert (half.cause, half.location, half.onset_s) == (whole.cause, whole.location, whole.onset_s)
        if whole.cause != "sensor_stuck":
            assert 0.6 < whole.size_degC < 5.0
            assert 0.3 < half.size_degC / whole.size_degC < 0.75
        else:
            assert whole.size_degC > 5.0


@pytest.mark.slow
def test_the_extremes_of_every_kind_stay_finite():
    every = [
        Hidden(cause, place, signal, onset_s, None, size)
        for cause, kind in effects().items()
        for size in (kind.low, kind.high)
        for place in (kind.places(load_device())[:: 19 if cause == "path" else 4] or (None,))
        for signal in (None, *kind.signals)
        for onset_s in (0.0, 300.0)
    ]
    for run in simulate_many([("2.5", 1, [effect]) for effect in every], _PERIOD_S):
        (told,) = run.truths
        json.dumps(asdict(told), allow_nan=False)
        assert max(np.abs(values).max() for values in run.trace.columns.values()) < 2000


@pytest.mark.parametrize("cause", effects())
def test_every_place_and_signal_can_be_drawn(cause):
    random = np.random.default_rng(8)
    drawn = [draw_hidden(random, cause, _LASTS_S) for _ in range(200)]
    assert {(each.location, each.signal) for each in drawn} == set(choices(cause, load_device()))
    assert all(each.end_s is None or each.end_s <= _LASTS_S for each in drawn)
    again = draw_hidden(np.random.default_rng(8), cause, _LASTS_S)
    assert again == draw_hidden(np.random.default_rng(8), cause, _LASTS_S) == drawn[0]


_COLD_SPOT = """
\"\"\"A body that cools a node: in a test.\"\"\"
import numpy as np
from ambient_trainer.simulator.additions import Added, Term
from ambient_trainer.simulator.hidden import Effect

class ColdSpot(Effect):
    unit, low, high = "W", 0.0, 5.0
    meaning = "heat taken away"

    def added(self, acting, name):
        hidden = acting.hidden
        return Added((Term("steady", -acting.share(), acting.device.pattern({hidden.location: hidden.amount})),))

EFFECT = ColdSpot()
"""


def test_a_new_effect_is_one_file(plugged):
    plugged(importlib.import_module(PLUGINS), "cold_spot", _COLD_SPOT)
    run = simulate("2.5", period_s=10.0, hide=["cold_spot:usb:500mW:from=5min:to=end"], sizes=True)
    drawn = draw_hidden(np.random.default_rng(0), "cold_spot", 900.0)
    (told,) = run.truths
    assert (told.cause, told.magnitude, told.unit, told.worst) == ("cold_spot", 0.5, "W", "usb_degC")
    assert (run.trace.column("usb_degC") < run.clean.column("usb_degC") - 1)[run.trace.time_s > 600].all()
    assert drawn.location in NODES
