"""What is hidden in simulated runs is found, with its place and driver; nothing is found where nothing is hidden."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_trainer.circuits.circuit import Addition
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox.choice import Limits, SelectionStep
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms import coupling, heat, mass
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat, HeatInTheCold
from ambient_trainer.diagnosis.greybox.model import GreyBox, Number
from ambient_trainer.diagnosis.greybox.pairs import fit_pair
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.screening import (
    Screened,
    change_candidates,
    every_candidate,
    permanent_candidates,
    screen,
    shortlist,
)
from ambient_trainer.diagnosis.greybox.stepwise import anchors, bare_fit, stepwise
from ambient_trainer.diagnosis.greybox.trials import Trial
from ambient_trainer.diagnosis.result import Cause

WIND_W_K = {"conductance_W_K": lambda now, degC: 0.3 + 0.12 * now["wind_m_s"]}
SUN, CURRENT = ("heat_source", ("board",), "sun_W_m2"), ("heat_source", ("board",), "current_A^2")
SUN_W = {"heat_W": lambda now, degC: 0.005 * now["sun_W_m2"]}
CURRENT_W = {"heat_W": lambda now, degC: 0.8 * now["current_A"] ** 2}
HIDDEN = {
    "sun": (SUN_W, {SUN}),
    "current squared": (CURRENT_W, {CURRENT}),
    "wind": ({**SUN_W, **WIND_W_K}, {SUN, ("ambient_coupling", ("board",), "wind_m_s")}),
    "mass": ({"mass": (0.4, 500.0)}, {("thermal_mass", ("board",), "")}),
    "nothing": ({}, set()),
}


@pytest.mark.parametrize(
    "hidden",
    ["current squared", "nothing", *(pytest.param(each, marks=pytest.mark.slow) for each in ("sun", "wind", "mass"))],
)
def test_what_is_hidden_is_named(circuit, simulated, recorded, hidden, seed):
    physics, named = HIDDEN[hidden]
    records = recorded(simulated(seed, **physics))
    model = GreyBox.of(circuit)
    selection = stepwise(bare_fit(model, records), anchors(model, records))
    assert {each.key for each in selection.final.model.mechanisms} == named, seed
    assert selection.final.rmse_degC < 0.06, seed


class Runaway(Heat):
    """1 W more for each K that a node is warmer than 25 degC: more than its loss, so it has no end."""

    def apply(self, network, values, record):
        network.vary([0], np.full((len(values), 1, record.samples), -1.0), np.array(25.0))


def test_what_runs_away_is_left_out_without_a_warning(circuit, simulated, recorded):
    fitted = bare_fit(GreyBox.of(circuit), recorded(simulated(8)))
    number = Number("heat_board", "W", 0.0)
    steady, runaway = (kind(("board",), (number,)) for kind in (Heat, Runaway))
    held = [each.mechanism for each in screen(Context(fitted), lambda context, columns: [steady, runaway])]
    assert [type(each) for each in held] == [Heat]


@pytest.mark.slow
def test_what_a_circuit_holds_already_is_not_found_again(circuit, simulated, seed):
    trace = simulated(seed, **WIND_W_K)
    change = {"change": {"unit": "1 per m/s", "value": 0.2}}
    given = replace(circuit, mechanisms=(Addition("Coupling", ("board",), "wind_m_s", None, None, change, {}),))
    lacking, held = diagnose(circuit, [trace]), diagnose(given, [trace])
    assert lacking.steps[0].cause.signal == "wind_m_s", seed
    assert held.steps == (), seed
    assert np.sqrt(np.nanmean(held.misfit.residual_degC**2)) < 0.06, seed


@pytest.mark.parametrize("seed", [39595, pytest.param(71271, marks=pytest.mark.slow)])
def test_a_law_gets_no_number_that_gains_nothing(circuit, simulated, recorded, seed):
    """Two runs of many in which noise, and how heat is held between samples, look like a resistance that changes."""
    records = recorded(simulated(seed, **CURRENT_W))
    model = GreyBox.of(circuit)
    selection = stepwise(bare_fit(model, records), anchors(model, records), offered=permanent_candidates)
    assert [each.name for each in selection.final.model.numbers] == ["C_board", "R_board", "heat_board"]


def held(now, degC, body_degC=28.0):
    """Heat from a body that holds on from 3:00 to 6:00, in air that goes from colder to warmer than it."""
    return 0.5 * (body_degC - degC) if 10800 < now["time_s"] < 21600 else 0.0


def test_a_body_that_warms_and_cools_by_turns_is_a_contact(circuit, simulated, seed):
    found = diagnose(circuit, [simulated(seed, heat_W=held)], [simulated(seed + 1)])
    step = found.steps[0]
    assert step.cause == Cause("contact", "board"), seed
    assert step.onset_s == pytest.approx(10800, abs=300), seed
    assert step.end_s == pytest.approx(21600, abs=300), seed
    assert step.magnitude.ci95[0] - 1 < 28.0 < step.magnitude.ci95[1] + 1, seed
    assert step.gain.p_value < 0.05, seed


@pytest.mark.slow
def test_a_body_that_is_put_there_and_taken_away_is_no_cooling(circuit, simulated, seed):
    named, heated = 0, {"heat_W": lambda now, degC: 8 * now["current_A"]}
    for draw in range(seed, seed + 4):
        on_s, off_s = np.random.default_rng(draw).uniform([0.2, 0.5], [0.4, 0.8]) * 36_000
        mass = lambda now, degC, on_s=on_s, off_s=off_s: 0.6 * (on_s < now["time_s"] < off_s), 250.0
        first = diagnose(circuit, [simulated(draw, **heated, mass=mass)], [simulated(draw + 1, **heated)]).steps[0]
        found = first.cause.name == "thermal_mass"
        assert first.end_s == pytest.approx(off_s, abs=1800) if found else first.confidence < 0.9, seed
        named += found
    assert named >= 2, seed


def test_a_clock_is_named_where_noise_is_most_of_what_is_left(circuit, simulated, seed):
    """Two logs: in one alone a shorter time constant may make up for a third of the offset."""
    logged = []
    for trace in (simulated(seed, noise_degC=0.8), simulated(seed + 2, noise_degC=0.8)):
        late = np.interp(trace.time_s - 600.0, trace.time_s, trace.columns["ambient_degC"])
        logged.append(replace(trace, columns={**trace.columns, "ambient_degC": late}))
    found = diagnose(circuit, logged)
    assert found.verdict_cause == Cause("clock_offset"), seed
    assert found.verdict.magnitude.value == pytest.approx(600.0, abs=200.0), seed


def test_a_lag_of_minutes_is_no_thermal_mass(circuit, simulated, seed):
    """From 3:00 on the reading follows by a low-pass filter of twice the board's time constant."""
    trace = simulated(seed)
    read, a = trace.columns["board_degC"].copy(), -np.expm1(-30.0 / 600.0)
    for k in range(361, len(read)):
        read[k] = read[k - 1] + a * (read[k] - read[k - 1])
    found = diagnose(circuit, [replace(trace, columns={**trace.columns, "board_degC": read})], [simulated(seed + 1)])
    assert found.verdict_cause == Cause("sensor_lag", "board"), seed
    assert found.verdict.onset_s == pytest.approx(10800, abs=600), seed


@pytest.mark.parametrize(
    ("ramp_s", "switched", "named"), [(0.0, False, True), (900.0, False, False), (0.0, True, False)]
)
def test_only_readings_that_jump_are_off_for_a_while(circuit, simulated, ramp_s, switched, named, seed):
    """By 1.5 degC for an hour, between jumps of what is logged: at once or within a quarter of it, or with a pump."""
    trace = simulated(seed)
    off = np.interp(trace.time_s, [11010, 11011 + ramp_s, 14580 - ramp_s, 14581], [0, 1.5, 1.5, 0])
    logged = {"pump_on": np.sign(off)} if switched else {}
    shown = replace(trace, columns={**trace.columns, **logged, "board_degC": trace.columns["board_degC"] + off})
    causes = {step.cause.name for step in diagnose(circuit, [shown]).steps}
    assert ("sensor_bias" in causes) == named, seed


@pytest.mark.parametrize("fault", ["sensor_stuck", pytest.param("sensor_drift", marks=pytest.mark.slow)])
def test_a_sensor_at_fault_is_named_where_nothing_is_known_good(circuit, simulated, fault, seed):
    """It stands still from 4:00 to 5:00, or drifts by 0.5 K/h from 5:00 on."""
    trace = simulated(seed)
    read = trace.columns["board_degC"].copy()
    if fault == "sensor_stuck":
        read[480:600] = read[480]
    else:
        read += 0.5 / 3600 * np.maximum(trace.time_s - 18000, 0)
    step = diagnose(circuit, [replace(trace, columns={**trace.columns, "board_degC": read})]).steps[0]
    assert step.cause == Cause(fault, "board"), seed
    assert step.onset_s == pytest.approx(14400 if fault == "sensor_stuck" else 18000, abs=600), seed


def test_a_sensor_of_whole_degrees_or_on_what_freezes_does_not_stand_still(circuit, simulated, recorded, seed):
    trace = simulated(seed)
    for decimals, creeps_K in ((1, 0.0), (0, 0.0), (4, 0.1)):
        creeping = [20.0 - creeps_K, 20.0, 21.6, 21.6 + creeps_K]
        read = np.round(np.interp(trace.time_s, [0, 9000, 9900, 36000], creeping), decimals)
        records = recorded(replace(trace, columns={**trace.columns, "board_degC": read}))
        found = Context(anchors(GreyBox.of(circuit), records)[0]).still("board")
        assert (found is None) == (decimals != 1), seed


def test_heat_that_creeps_is_not_surely_a_drift(circuit, simulated, seed):
    """Contents that warm a box ever more: one sensor in it cannot tell that from its own drift."""
    found = diagnose(circuit, [simulated(seed, heat_W=lambda now, degC: 0.08 * now["time_s"] / 3600.0)])
    for step in found.steps:
        if step.cause.name == "sensor_drift":
            assert step.confidence < 0.7, seed
            assert Cause("heat_source", "board", "time_s") in step.indistinguishable_from, seed


def thermostat(seed):
    """A box that a controller keeps warm with a heater that acts 90 s later; what else is in it warms it, too."""
    draw = np.random.default_rng(seed)
    size, period_s = 1500, 15.0
    air_degC = 22.0 + np.cumsum(draw.normal(0, 0.02, size))
    current_A, box_degC, degC = np.zeros(size), np.zeros(size), 27.0
    constant_K = draw.uniform(3.0, 5.0)
    for k in range(size):
        box_degC[k] = degC + draw.normal(0, 0.02)
        current_A[k] = np.clip(current_A[k - 1] + 0.2 * (30.0 - box_degC[k]), 0.1, 2.0)
        warm_K = 2.9 * current_A[max(k - 6, 0)] + constant_K
        degC += (air_degC[k] + warm_K - degC) * period_s / 700.0
    columns = {"board_degC": box_degC, "ambient_degC": air_degC, "heater_A": current_A}
    return Trace("thermostat.csv", period_s * np.arange(size), columns)


@pytest.mark.parametrize("seed", [1, pytest.param(4, marks=pytest.mark.slow), pytest.param(7, marks=pytest.mark.slow)])
def test_a_heater_that_swings_is_late_by_less_than_a_swing(circuit, seed):
    """Beside it, what is always there; each shows itself beside the other."""
    steps = diagnose(circuit, [thermostat(seed)]).steps
    drivers = [each.cause.signal or "" for each in steps if each.cause.name == "heat_source"]
    late_s = [float(each[:-1].split(",")[1]) for each in drivers if each.startswith("delay(heater_A")]
    assert late_s == [pytest.approx(90.0, abs=30.0)]
    assert {each.cause.name for each in steps if each.confidence >= 0.9} == {"heat_source"}


@pytest.mark.parametrize("seed", [2, pytest.param(5, marks=pytest.mark.slow), pytest.param(8, marks=pytest.mark.slow)])
def test_a_heater_with_a_body_of_its_own_is_late_by_a_lag(circuit, simulated, seed):
    """The body of the heater warms first; no sensor is blamed for it."""
    draw = np.random.default_rng(seed)
    now_s, lag_s = np.arange(36000.0), draw.uniform(200.0, 400.0)
    switched_s = np.cumsum(draw.uniform(200.0, 900.0, 200))
    on = np.searchsorted(switched_s, now_s) % 2 * 1.0
    share = 1.0 - np.exp(-1.0 / lag_s)
    out_W = 4.0 * lfilter([share], [1.0, share - 1.0], on)
    trace = simulated(seed, heat_W=lambda now, degC: np.interp(now["time_s"], now_s, out_W))
    steps = diagnose(circuit, [replace(trace, columns={**trace.columns, "heater_on": on[::30]})]).steps
    drivers = [each.cause.signal or "" for each in steps]
    late_s = [float(each[:-1].split(",")[1]) for each in drivers if each.startswith("lag(heater_on")]
    assert late_s == [pytest.approx(lag_s, rel=0.3)]
    assert len(steps) == 1


def test_what_is_no_finding_keeps_no_pair_away(circuit, simulated, recorded, monkeypatch):
    """Such as a window beside a current; and a loss that begins goes with the column alone that does best by itself.
    Of two pyranometers of one sun one is followed."""
    trace = simulated(5, heat_W=lambda now, degC: 1.5 + 0.8 * now["current_A"] ** 2)
    beam = {"beam_W_m2": np.where(trace.columns["sun_W_m2"] > 400, trace.columns["sun_W_m2"], 0.0)}
    trace = replace(trace, columns={**trace.columns, **beam})
    bare, begins = bare_fit(GreyBox.of(circuit), recorded(trace)), {}

    def tried(before, driver=None, onset_s=None):
        number = Number("heat_board", "W", 0.1)
        heat = Heat(("board",), (number,), driver and Expression(driver), onset_s)
        return Trial.of(before, fit(before.model.with_mechanism(heat), before.records))

    def fit_candidates(before, screened, progress):
        driver = before.model.mechanisms[0].driver.text
        begins[driver] = not all(each.mechanism.permanent for each in screened)
        return [replace(tried(before, onset_s=18000.0), rmse_degC=1e-3) if driver == "current_A" else tried(before)]

    monkeypatch.setitem(fit_pair.__globals__, "fit_candidates", fit_candidates)
    plain, *rest = (tried(bare, driver) for driver in ("current_A", "current_A^2", "sun_W_m2", "beam_W_m2"))
    steps = fit_pair(SelectionStep(bare, plain, (plain, *rest), 2), (), Limits(), every_candidate, lambda *given: None)
    assert [each.chosen.mechanism.key[2] for each in steps] == ["current_A^2", ""]
    assert begins == {"current_A": True, "current_A^2": True, "sun_W_m2": False}


def test_a_search_ends_where_nothing_is_left(circuit, recorded):
    still = np.full(600, 25.0)
    trace = Trace("still.csv", 30.0 * np.arange(600), {"board_degC": still, "ambient_degC": still})
    bare = bare_fit(GreyBox.of(circuit), recorded(trace))
    assert bare.held_out_rmse_degC == 0
    assert [each.chosen for each in stepwise(bare, offered=lambda *given: iter(())).steps] == [None]


@pytest.mark.parametrize("column", ["wind_m_s", "case_fan_frac"])
def test_what_moves_air_heats_nothing(circuit, simulated, recorded, column):
    """Heat that nothing logs, and that comes and goes with the wind or a fan."""
    trace = simulated(3, heat_W=lambda now, degC: 0.5 * now["wind_m_s"])
    moved = {**trace.columns, column: trace.columns["wind_m_s"]}
    bare = bare_fit(GreyBox.of(circuit), recorded(replace(trace, columns=moved)))
    drivers = [(each.mechanism.cause, each.mechanism.key[2]) for each in screen(Context(bare), permanent_candidates)]
    assert ("ambient_coupling", column) in drivers
    assert not [each for each in drivers if each[0] == "heat_source" and column in each[1]]


def test_no_loss_falls_with_what_heats_or_blows(circuit, simulated, recorded):
    """It would read as heat does: a laptop's, by the power of its battery."""
    trace = simulated(6)
    shares = dict.fromkeys(("lamp_frac", "blind_frac"), trace.columns["humidity_frac"])
    context = Context(bare_fit(GreyBox.of(circuit), recorded(replace(trace, columns={**trace.columns, **shares}))))
    most = {each.key[2]: -each.numbers[0].low * context.extent(each.driver)[1] for each in coupling.candidates(context)}
    judged = ("current_A", "sun_W_m2", "wind_m_s", "lamp_frac", "humidity_frac", "blind_frac")
    assert [name for name in judged if most[name] > 0.5] == ["humidity_frac", "blind_frac"]


def test_a_cooler_takes_heat_away_by_the_power_that_it_uses(circuit, simulated, seed):
    """A measured car's air conditioner was left out, as any other power only warms."""
    trace = simulated(seed, heat_W=lambda now, degC: -3.0 * now["current_A"])
    columns = {name: row for name, row in trace.columns.items() if name != "current_A"}
    found = diagnose(circuit, [replace(trace, columns={**columns, "aircon_kW": 0.002 * trace.columns["current_A"]})])
    assert (found.verdict_cause.name, found.verdict_cause.signal) == ("heat_source", "aircon_kW"), seed
    assert found.verdict.magnitude.value < 0, seed


def test_no_heater_cools_or_heats_beyond_a_level_alone(circuit, simulated, recorded):
    """With a negative heat a second heater made up for how late a measured first one warmed; a load beyond a level for
    a fan that began in mid-log."""
    trace = simulated(6)
    renamed = {"current_A": "heater2_frac", "humidity_frac": "heater_cooling_frac", "wind_m_s": "valve_frac"}
    columns = {renamed.get(name, name): row for name, row in trace.columns.items()}
    columns["ac1_W"] = columns["ac_power_W"] = columns["sun_W_m2"]  # alternating current, and a room's air conditioner
    columns["sun_W_m2"] = columns["sun_W_m2"] - 2.0  # as a pyranometer reads at night
    context = Context(bare_fit(GreyBox.of(circuit), recorded(replace(trace, columns=columns))))
    least = {each.driver.text: each.numbers[0].low for each in heat.candidates(context) if each.driver is not None}
    judged = ("heater2_frac", "ac1_W", "ac_power_W", "heater_cooling_frac", "valve_frac")
    assert [least[name] for name in judged] == [0.0, 0.0, -np.inf, -np.inf, -np.inf]
    beyond = {each.columns[0] for each in context.tuned_drivers if ">" in each.text}
    assert {"heater2_frac", "valve_frac"} & beyond == {"valve_frac"}
    falls = {each.driver.text: each.numbers[0].low for each in coupling.candidates(context)}
    assert falls["sun_W_m2"] * columns["sun_W_m2"].max() > -0.2


@pytest.mark.parametrize(("began_degC", "apart"), [(26.0, False), (65.0, True)])
def test_a_body_does_not_begin_hotter_than_all_that_is_known(circuit, recorded, began_degC, apart):
    """A body of 2,000 J/K behind a board that begins in the air's temperature: what else heats it is not its own."""
    air_degC, degC = 20.0 + 4.0 * np.sin(np.arange(0.0, 36000.0, 5.0) / 3000.0), np.array([20.0, began_degC])
    board_degC = []
    for now_degC in air_degC:
        board_degC.append(degC[0])
        inward_W = 0.4 * (degC[1] - degC[0])
        degC = degC + 5.0 * np.array([(inward_W + 0.4 * (now_degC - degC[0])) / 120.0, -inward_W / 2000.0])
    columns = {"board_degC": np.array(board_degC)[::6], "ambient_degC": air_degC[::6]}
    held = recorded(Trace("board.csv", 30.0 * np.arange(1200), columns))
    bare = bare_fit(GreyBox.of(circuit), held)
    body = next(each for each in mass.candidates(Context(bare)) if not each.sees_ambient)
    known = replace(bare.model, own=tuple(replace(n, value=v) for n, v in zip(bare.model.own, (120.0, 2.5))))
    fitted = fit(known.with_mechanism(body.with_values([0.4, 5000.0])), held)
    assert fitted.rmse_degC < 0.1
    assert Trial.of(bare, fitted).at_bounds == apart


def test_the_plain_law_is_tried_where_one_with_a_further_number_promises_more():
    """The fit of the latter takes many steps, and may end far from its best."""

    def screened(kind: type[Heat], driver: str, *amounts: str) -> Screened:
        numbers = tuple(Number(each, "W", 1.0) for each in amounts)
        return Screened(kind(("board",), numbers, Expression(driver)), 1.0, None)

    others = [screened(Heat, f"zone{index}_frac", "heat_board") for index in range(6)]
    cold = screened(HeatInTheCold, "current_A^2", "heat_board", "growth_board")
    plain = screened(Heat, "current_A^2", "heat_board")
    assert plain in shortlist([*others, cold, plain])


def flame(time_s):
    """By turns none and some, of two sizes."""
    return (np.asarray(time_s) % 5000 < 1800) * (1.0 + 0.6 * (np.asarray(time_s) % 11000 < 5000))


def test_a_flame_and_the_water_that_takes_its_heat_are_both_named(circuit, simulated, seed):
    """The gas meter reads 1.2 V where nothing burns; water flows before the flame is lit, and for longer."""

    def flow(time_s):
        return 40.0 * (np.asarray(time_s) % 5000 < 2500) * (1.0 + 0.5 * np.sin(np.asarray(time_s) / 7000))

    trace = simulated(
        seed,
        heat_W=lambda now, degC: 60.0 * flame(now["time_s"]),
        conductance_W_K=lambda now, degC: 0.2 + 0.06 * flow(now["time_s"]),
    )
    logged = {"gas_V": 1.2 + 0.8 * flame(trace.time_s), "flow_Hz": flow(trace.time_s)}
    found = diagnose(circuit, [replace(trace, columns={**trace.columns, **logged})])
    causes = {(step.cause.name, step.cause.signal) for step in found.steps}
    assert causes == {("heat_source", "gas_V - 1.2"), ("ambient_coupling", "flow_Hz")}, seed


def heater_on(time_s):
    return 1.0 * (np.asarray(time_s) % 3000 < 2400)


def opened(now, degC):
    """A door that nothing logs, beside a heater that is logged."""
    return 20.0 if now["time_s"] % 7000 < 900 else 0.4


def test_a_logged_heater_is_named_whatever_is_left(circuit, simulated, monkeypatch, seed):
    """Also where a black box would do much better."""
    monkeypatch.setitem(diagnose.__globals__, "black_box_rmse_degC", lambda *given: 0.3)
    trace = simulated(seed, heat_W=lambda now, degC: 12.0 * heater_on(now["time_s"]), conductance_W_K=opened)
    found = diagnose(circuit, [replace(trace, columns={**trace.columns, "heater_on": heater_on(trace.time_s)})])
    assert (found.verdict_cause, bool(found.notes)) == (Cause("heat_source", "board", "heater_on"), True), seed


def test_a_body_that_is_put_there_for_a_while_is_no_place_for_others(circuit, simulated, recorded):
    """Nothing joins it before and after: an amount there has no scale."""
    records = recorded(simulated(1))
    bare = fit(GreyBox.of(circuit), records)
    put = replace(next(iter(mass.begun(Context(bare)))), onset_s=9000.0, end_s=18000.0)
    beside = fit(bare.model.with_mechanism(put), records, [None for _ in records], most=2)
    for each in screen(Context(beside), change_candidates):
        assert np.isfinite(beside.model.with_mechanism(each.mechanism).z()).all(), str(each.mechanism)
        assert not each.mechanism.key[2].startswith("ambient_degC >"), "known-good records would have shown it"


def test_a_pressure_heats_by_its_rate_alone_and_a_sun_that_hardly_moves(circuit, simulated, recorded):
    trace = simulated(3)
    grows = np.linspace(0, 1, len(trace.time_s)) ** 2
    columns = {"air_hPa": 300 + 700 * grows, "rh1_frac": grows, "sun_W_m2": 990 + 20 * grows}
    fitted = bare_fit(GreyBox.of(circuit), recorded(replace(trace, columns={**trace.columns, **columns})))
    drivers = {each.driver.text for each in heat.candidates(Context(fitted)) if each.driver is not None}
    assert {each for each in drivers if "humidity" in each or "hPa" in each or "rh1" in each} == {"d(air_hPa)/dt"}
    assert "sun_W_m2" in drivers


def test_what_is_refined_is_taken_only_where_it_leaves_less(circuit, simulated, recorded, monkeypatch):
    """A search for a delay that ends beside it: half an hour late, where ten minutes are right."""
    trace = simulated(6)
    late = np.interp(trace.time_s - 600.0, trace.time_s, trace.columns["sun_W_m2"])
    warmer = trace.columns["board_degC"] + lfilter([0.001], [1, -0.95], late)
    bare = bare_fit(GreyBox.of(circuit), recorded(replace(trace, columns={**trace.columns, "board_degC": warmer})))

    def heated(delay_s):
        return Heat(("board",), (Number("heat_board", "W", 0.01),), Expression(f"delay(sun_W_m2, {delay_s})"))

    def spoiled(fitted, index=-1):
        return fit(bare.model.with_mechanism(heated(1800)), fitted.records, prior=fitted.prior)

    monkeypatch.setitem(stepwise.__globals__, "refine_timing", spoiled)
    step = stepwise(bare, (), Limits(), offered=lambda context, columns: iter([heated(600)])).steps[0]
    assert step.chosen.mechanism.driver.text == "delay(sun_W_m2, 600)"
