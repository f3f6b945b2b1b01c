"""Hidden heat: its budget, against an adaptive solver, and at rest; hidden instruments: what they make of a course."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.simulator.additions import AIR, TERMS, Additions, together
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.heat import HeatBalance
from ambient_trainer.simulator.hidden import Acting, Hidden
from ambient_trainer.simulator.run import Run, integrate
from ambient_trainer.simulator.signals import SIGNALS, signal
from ambient_trainer.simulator.text import hidden_text

_PHONE = load_device()
NODES = tuple(_PHONE.nodes)
_BALANCE = HeatBalance([_PHONE])
_COUNT = 1500
_ONSET_S, _END_S = 300.0, 1200.0

_HEAT = [
    Hidden("heat_source", "board2", None, _ONSET_S, _END_S, 0.8),
    Hidden("heat_source", "soc", "radio_on", 0.0, None, 0.6),
    Hidden("heat_source", "usb", "charger_on", 0.0, None, 0.6),
    Hidden("heat_source", "display", "irradiance_W_m2", 0.0, None, 1.5),
    Hidden("heat_source", "usb", "accessory_current_A", 0.0, None, 0.3),
]
_LOSSES = [
    Hidden("ambient_coupling", None, None, _ONSET_S, _END_S, 1.0),
    Hidden("ambient_coupling", "display", "fan_on", 0.0, None, -0.6),
    Hidden("ambient_coupling", "back", "wind_m_s", 0.0, None, -0.4),
    Hidden("convection_law", None, None, _ONSET_S, None, 2.0),
]
_BODIES = [
    Hidden("contact", "back", None, _ONSET_S, _END_S, 0.3, body="hand"),
    Hidden("contact", None, None, _ONSET_S, None, 0.3, body="pocket"),
    Hidden("contact", "display", None, 0.0, None, 0.3, body="table"),
    Hidden("thermal_mass", "display", None, _ONSET_S, _END_S, 60.0),
    Hidden("thermal_mass", "flash", None, 0.0, None, 15.0),
    Hidden("path", "flash-usb", None, _ONSET_S, _END_S, 0.2),
]
_ALL = [*_HEAT, *_LOSSES, *_BODIES]


def _acting(effect, count=_COUNT, seed=4):
    time_s, signals = np.arange(count) * 1.0, {}
    if effect.signal is not None:
        window = effect.lasting(time_s, 1.0)
        signals[effect.signal] = signal(effect.signal, time_s, window, np.random.default_rng(3))
    return Acting(_PHONE, time_s, 1.0, signals, effect, lambda: np.random.default_rng(seed))


def _added(effect, number=0, count=_COUNT):
    return _acting(effect, count).part(number)


def _run(count=_COUNT):
    activity = np.full(count, _PHONE.activity_index([]))
    activity[200:700] = _PHONE.activity_index(["cpu_50"])
    return Run(_PHONE, 10.0, 10.0 + 15.0 * np.arange(count) / count, activity, np.ones(count), 0)


def _means(values):
    return (values[:-1] + values[1:]) / 2


@pytest.fixture(scope="module")
def driven():
    """Every effect in one batch: the run, what was added, and what came of it."""
    parts = [_added(effect) for effect in _ALL]
    return dict(zip(_ALL, zip(parts, integrate([_run()] * len(_ALL), 1.0, added=parts))))


@pytest.mark.parametrize("effect", _ALL, ids=hidden_text)
def test_heat_in_is_heat_stored_plus_heat_lost(driven, effect):
    """A budget of the whole run from temperatures alone: what flows between two things appears in none of its sums."""
    part, done = driven[effect]
    nodes, bodies, air = done.nodes_degC, done.bodies_degC, done.run.air_degC
    taken_W = _BALANCE.heat_in(nodes, _BALANCE.demand(done.run.activity, np.ones(_COUNT))).sum(axis=1)
    terms_W = np.zeros(_COUNT - 1)
    for term in part.terms:  # coefficients hold until the next sample
        terms_W += term.course[:-1] * _means(TERMS[term.kind](nodes, air, _BALANCE) @ term.pattern)
    temperatures = {AIR: air, **dict(zip(NODES, nodes.T)), **{b.name: t for b, t in zip(part.bodies, bodies.T)}}
    fixed = {AIR, *(body.name for body in part.bodies if np.isinf(body.capacity_J_K))}
    outside_W = np.zeros(_COUNT - 1)
    for link in part.links:
        if fixed & {link.one, link.other}:
            inner, outer = (link.one, link.other) if link.other in fixed else (link.other, link.one)
            outside_W += link.conductance_W_K[:-1] * _means(temperatures[outer] - temperatures[inner])
    lost_W = _BALANCE.lost(nodes, air).sum(axis=1)
    finite = [k for k, body in enumerate(part.bodies) if np.isfinite(body.capacity_J_K)]
    stored_J = _BALANCE.capacitance[0] @ (nodes[-1] - nodes[0]) + sum(
        part.bodies[k].capacity_J_K * (bodies[-1, k] - bodies[0, k]) for k in finite
    )
    budget_J = (_means(taken_W - lost_W) + terms_W + outside_W).sum()
    moved_J = np.abs(taken_W).sum() + np.abs(terms_W + outside_W).sum()
    assert stored_J == pytest.approx(budget_J, abs=1e-4 * moved_J)
    assert moved_J > 100


def test_integration_agrees_with_an_adaptive_solver():
    effects = [_BODIES[0], _BODIES[3], _BODIES[5], _LOSSES[0], _LOSSES[3], _HEAT[0]]
    part = together([_added(effect, number) for number, effect in enumerate(effects)])
    run = _run(500)
    ours = integrate([run], 1.0, added=[part])[0]
    additions = Additions(HeatBalance([run.device]), [part])
    state = np.concatenate([ours.nodes_degC[0], ours.bodies_degC[0]])
    for k in range(len(run.air_degC) - 1):
        demand = additions.balance.demand(run.activity[k : k + 1], np.ones(1))
        rates, slope = additions.rates_during(k), run.air_degC[k + 1] - run.air_degC[k]

        def derivative(t, x, rates=rates, air=run.air_degC[k], slope=slope, demand=demand):
            return rates(x[None], np.array([air + slope * t]), demand)[0]

        state = solve_ivp(derivative, (0, 1.0), state, method="DOP853", rtol=1e-9, atol=1e-9).y[:, -1]
    assert np.concatenate([ours.nodes_degC[-1], ours.bodies_degC[-1]]) == pytest.approx(state, abs=1e-3)


def test_what_is_attached_since_ever_is_at_rest_with_the_phone():
    mass = Hidden("thermal_mass", "display", None, 0.0, None, 100.0)
    run = Run(_PHONE, 20.0, np.full(900, 20.0), np.zeros(900, dtype=int), np.ones(900), 0)
    done = integrate([run], 1.0, added=[_added(mass, count=900)])[0]
    assert np.ptp(done.nodes_degC, axis=0).max() < 1e-6
    assert np.ptp(done.bodies_degC, axis=0).max() < 1e-6


def test_a_strap_conducts_the_stated_heat_at_rest():
    part = _added(Hidden("path", "flash-usb", None, 0.0, None, 0.2))
    additions = Additions(_BALANCE, [part])
    flash, usb = NODES.index("flash"), NODES.index("usb")
    state = np.zeros((1, additions.width))
    state[0, flash], state[0, usb] = 40.0, 20.0
    state[0, -1] = 30.0  # the strap's own, halfway
    flows = additions.linked(5, state, np.zeros(1))[0]
    assert (flows[flash], flows[usb]) == pytest.approx((-0.2 * 20, 0.2 * 20))


def test_a_fan_doubles_the_convection_at_ten_kelvin_and_only_that():
    part = _added(Hidden("ambient_coupling", None, None, 0.0, None, -0.5))
    nodes, air = np.full((1, len(NODES)), 30.0), np.array([20.0])
    more_W = TERMS["blown"](nodes, air, _BALANCE)[0] * part.terms[0].pattern
    assert -more_W == pytest.approx(_BALANCE.convected(nodes, air)[0])
    assert [term.kind for term in part.terms] == ["blown"]
    assert part.terms[0].course.mean() == pytest.approx(1.0, abs=0.05)  # turbulence


def test_a_case_takes_from_convection_and_radiation_and_never_all_of_it():
    case = Hidden("ambient_coupling", "display", None, 0.0, None, 1.0)
    terms = {term.kind: term for term in _added(case).terms}
    assert {kind: term.pattern[NODES.index("display")] for kind, term in terms.items()} == pytest.approx(
        {"convected": -0.5, "radiated": -0.25}
    )
    assert all(np.count_nonzero(term.pattern) == 1 for term in terms.values())
    cases = [Hidden("ambient_coupling", None, None, 0.0, None, 9.0)] * 3
    part = together([_added(case) for case in cases])
    coefficients = Additions(_BALANCE, [part]).coefficients(0)
    assert min(coefficient.min() for coefficient in coefficients.values()) > -1.0


def test_a_draught_is_like_convection_at_fifteen_kelvin_nearly_nothing_below_and_limited_above():
    nodes = np.full((4, len(NODES)), 20.0)
    air = np.array([5.0, 17.0, 35.0, -180.0])
    drawn_W, own_W = TERMS["draught"](nodes, air, _BALANCE), -_BALANCE.convected(nodes, air)
    display = NODES.index("display")
    assert drawn_W[:, display] / own_W[:, display] == pytest.approx([1.0, 0.0769, 1.0, 1.9888], abs=1e-3)


def test_a_contact_is_shared_by_area():
    part = _added(Hidden("contact", None, None, 0.0, None, 0.3))
    shares = {link.other: link.conductance_W_K[9] for link in part.links if link.other in NODES}
    areas = {node: _PHONE.nodes[node].surface_m2 for node in _PHONE.surfaces}
    grip = sum(shares.values())
    assert shares == pytest.approx({node: grip * area / sum(areas.values()) for node, area in areas.items()})
    assert 0.3 * 0.3 <= grip <= 1.7 * 0.3


def test_a_charger_warms_up_holds_and_tapers():
    course = _added(_HEAT[0]).terms[0].course
    assert course[:300].max() == 0.0
    assert course[1201:].max() == 0.0
    assert course[310] < 0.4
    assert course[500:800].mean() == pytest.approx(1.0, abs=0.1)
    assert course[1100:1200].mean() < 0.95 * course[500:800].mean()


@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_is_zero_outside_its_window_and_alive_inside(name):
    time_s = np.arange(-600.0, 9000.0, 5.0)
    values = signal(name, time_s, (1000.0, 8000.0), np.random.default_rng(6))
    outside = (time_s < 1000.0) | (time_s >= 8000.0)
    assert not values[outside].any()
    assert np.isfinite(values).all()
    assert values.min() >= 0.0
    inside = values[~outside]
    assert inside.std() > 0.0
    if name.endswith("_on"):
        assert set(np.unique(inside)) == {0.0, 1.0}
        assert 0.2 < inside.mean() < 0.8


def _ailing(effect, what, values, *further):
    """What an effect makes of the ``values`` that are felt, read or air."""
    acting = _acting(effect, len(values), seed=1)
    return getattr(acting.effect, what)(acting, values, *further)


def test_a_bias_slews_in():
    flat = np.full(3000, 21.0)
    shifted = _ailing(Hidden("sensor_bias", "usb", None, 1000.0, 2000.0, 2.0), "felt", flat) - flat
    assert shifted[[999, 1500, 2100]] == pytest.approx([0.0, 2.0, 0.0])
    assert shifted[1045] == pytest.approx(1.0, abs=0.05)


def test_a_gain_turns_about_its_reference():
    course = np.linspace(-10.0, 60.0, 3000)
    error = _ailing(Hidden("sensor_gain", "usb", None, 0.0, None, 0.1), "felt", course) - course
    assert error[np.argmin(np.abs(course - 25.0))] == pytest.approx(0.0, abs=2e-3)
    assert np.polyfit(course, error, 1)[0] == pytest.approx(0.1, rel=0.03)
    assert np.polyfit(course, error, 2)[0] != pytest.approx(0.0, abs=1e-5)  # bent


def test_a_lag_delays_a_ramp_by_its_size_and_is_of_second_order():
    lag = Hidden("sensor_lag", "usb", None, 0.0, None, 100.0)
    ramp, step = 0.01 * np.arange(3000.0), np.where(np.arange(3000) < 1000, 0.0, 1.0)
    assert (ramp - _ailing(lag, "felt", ramp))[-1] / 0.01 == pytest.approx(100.0, rel=1e-6)
    slope = np.diff(_ailing(lag, "felt", step))
    assert slope[1000] < 0.2 * slope.max()  # a single lag is steepest at once


def test_a_stuck_sensor_flickers_by_its_last_digit_and_keeps_what_it_read():
    reading = np.round(np.linspace(10.0, 20.0, 3000), 1)
    for size, value in ((31.4, 31.4), (None, reading[1000])):
        read = _ailing(Hidden("sensor_stuck", "usb", None, 1000.0, None, size), "read", reading, 0.1)
        assert np.array_equal(read[:1000], reading[:1000])
        assert np.unique(read[1000:]) == pytest.approx([value - 0.1, value, value + 0.1])
        assert (read[1000:] == value).mean() > 0.95


def test_a_drift_reaches_what_it_says_but_not_in_a_straight_line():
    drift = _ailing(Hidden("sensor_drift", "usb", None, 0.0, None, 1.2), "felt", np.zeros(3600))
    assert drift[-1] == pytest.approx(1.2, rel=1e-2)
    assert drift[1800] < 0.95 * 0.6


def test_a_clock_ahead_makes_the_reference_late():
    step = np.where(np.arange(3000) < 1000, 0.0, 1.0)
    for ahead_s in (60.0, -60.0):
        shifted = _ailing(Hidden("clock_offset", None, None, 0.0, None, ahead_s), "air", step)
        assert np.argmax(shifted > 0.5) == pytest.approx(1000 + ahead_s, abs=1)
