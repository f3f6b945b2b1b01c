"""Everything at once, and what is needless goes: what shows itself only beside others is found, and nothing else."""

import importlib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.backward import eliminate_backward, steps_to
from ambient_trainer.diagnosis.greybox.choice import Limits, SelectionStep
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.mechanisms import mass, path
from ambient_trainer.diagnosis.greybox.mechanisms.latent import Latent
from ambient_trainer.diagnosis.greybox.model import GreyBox, Number
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.screening import permanent_candidates
from ambient_trainer.diagnosis.greybox.stepwise import Selection, bare_fit, continued
from ambient_trainer.diagnosis.record import records

from ...conftest import in_air
from .conftest import heat
from .test_places import PAIR

POINTS = "abcdef"


def together(now, degC):
    return 0.004 * now["sun_W_m2"] + 0.8 * now["current_A"] ** 2 - 1.5


def test_what_was_hidden_together_is_left_of_everything(circuit, simulated, recorded, seed):
    """Sun, a current and constant cooling beside a body: humidity, wind and the current itself heat nothing."""
    bare = bare_fit(GreyBox.of(circuit), recorded(simulated(seed, heat_W=together, mass=(0.4, 500.0))))
    found = eliminate_backward(bare)
    assert found is not None, seed
    heats = {each.key[2] for each in found.model.mechanisms if each.cause == "heat_source"}
    assert heats == {"", "sun_W_m2", "current_A^2"}, (seed, heats)
    assert found.rmse_degC < 0.06, seed
    alone = Selection(bare, bare, (), SelectionStep(bare, None, (), 0))
    steps = continued(alone, found, (), Limits(least_degC=0.05)).steps[: len(found.model.mechanisms)]
    rivals = [{each.mechanism.key for each in step.trials} - {step.chosen.mechanism.key} for step in steps]
    assert all(rivals), seed


def test_a_peltier_element_cools_by_its_current_and_warms_by_its_square(circuit, simulated, recorded, seed):
    trace = simulated(seed, heat_W=lambda now, degC: 0.9 * now["current_A"] ** 2 - 3.0 * now["current_A"] + 1.0)
    named = {each.replace("current", "tec"): row for each, row in trace.columns.items()}
    found = eliminate_backward(bare_fit(GreyBox.of(circuit), recorded(replace(trace, columns=named))))
    assert found is not None, seed
    assert {each.key[2] for each in found.model.mechanisms} == {"", "tec_A", "tec_A^2"}, seed


def jacketed(seed):
    """A vessel at rest in a jacket whose heater is turned up and down; something that nobody logs heats it as well."""
    draw, period_s, samples = np.random.default_rng(seed), 10.0, 1500
    shares = np.repeat([0.5, 1.0, 0.7], [*(steps := draw.integers(150, 300, 2) * [1, 4]), samples - steps.sum()])
    power_W, between_W_K, loss_W_K = 16 * shares + draw.uniform(3, 8), draw.uniform(2.5, 4), draw.uniform(0.15, 0.3)
    room_degC, rows = 26.0 + np.cumsum(draw.normal(0, 0.01, samples)), []
    jacket = vessel = room_degC[0] + power_W[0] / loss_W_K
    for into_W, air in zip(power_W, room_degC):
        rows.append([jacket, vessel])
        for _ in range(10):
            flow_W = between_W_K * (jacket - vessel)
            jacket, vessel = (
                jacket + period_s / 10 * (into_W - flow_W - loss_W_K * (jacket - air)) / 1500.0,
                vessel + period_s / 10 * flow_W / 4000.0,
            )
    fast, slow = np.array(rows).T + draw.normal(0, 0.03, (2, samples))
    columns = {"fast_degC": fast, "slow_degC": slow, "ambient_degC": room_degC, "heater_frac": shares}
    return Trace("jacket", period_s * np.arange(samples), columns)


def test_a_circuit_that_never_settles_is_searched_from_its_own_numbers(seed, monkeypatch):
    module = importlib.import_module("ambient_trainer.diagnosis.diagnose")  # its name is a function's, too
    nothing = lambda bare, *rest: Selection(bare, bare, (), SelectionStep(bare, None, (), 0))  # noqa: E731
    monkeypatch.setattr(module, "stepwise", nothing)
    found = {(each.cause.name, each.cause.signal) for each in diagnose(PAIR, [jacketed(seed)]).steps}
    assert ("heat_source", "heater_frac") in found, seed


def test_nothing_is_left_where_nothing_is_hidden(circuit, simulated, recorded, seed):
    bare = bare_fit(GreyBox.of(circuit), recorded(simulated(seed)))
    assert eliminate_backward(bare) is None, seed


def test_a_plate_below_six_points_warms_one_and_that_the_others(seed):
    """No point by itself gains much by the plate: a body behind each did better in a measured pouch cell."""
    draw = np.random.default_rng(seed)
    time_s = 2.0 * np.arange(600)
    plate_degC = 20.0 + 25.0 * (1 - np.exp(-time_s / 60.0)) * (time_s < draw.uniform(500, 700))
    joined_W_K = np.diag(draw.uniform(0.1, 0.3, 5), 1)
    joined_W_K += joined_W_K.T
    loss_W_K, heated = draw.uniform(0.03, 0.06, 6), int(draw.integers(6))

    def slope(now_s, degC):
        flow_W = joined_W_K @ degC - joined_W_K.sum(axis=1) * degC + loss_W_K * (20.0 - degC)
        flow_W[heated] += 0.4 * (np.interp(now_s, time_s, plate_degC) - degC[heated])
        return flow_W / 12.0

    read = solve_ivp(slope, (0, time_s[-1]), np.full(6, 20.0), t_eval=time_s, max_step=2.0).y
    columns = {f"{name}_degC": row + draw.normal(0, 0.01, 600) for name, row in zip(POINTS, read)}
    trace = Trace("plate", time_s, {**columns, "ambient_degC": np.full(600, 20.0), "plate_degC": plate_degC})
    circuit = forward(in_air(" ".join(POINTS), 100, 5))
    found = eliminate_backward(bare_fit(GreyBox.of(circuit), records(trace, circuit.inputs, list(columns), 2.0)))
    joined = {frozenset(each.places[0].split("-")) for each in found.model.mechanisms}
    assert joined == {*map(frozenset, pairwise(POINTS)), frozenset((POINTS[heated], "plate"))}, seed


def test_heaters_with_bodies_of_their_own_heat_those(seed):
    """Two plates that exchange heat, each under a heater that warms first: in measured ones, too."""
    draw = np.random.default_rng(seed)
    time_s, shares = 2.0 * np.arange(900), draw.choice([0.0, 0.4, 1.0], (2, 18)).repeat(50, axis=1)
    core_W_K, between_W_K, loss_W_K = draw.uniform(0.15, 0.3, 2), draw.uniform(0.02, 0.05), draw.uniform(0.04, 0.08, 2)

    def slope(now_s, degC):
        plates, cores = degC[:2], degC[2:]
        out_W = core_W_K * (cores - plates)
        exchanged_W = between_W_K * (plates[::-1] - plates)
        power_W = 6.0 * shares[:, min(int(now_s / 2.0), 899)]
        return [*((out_W + exchanged_W + loss_W_K * (20.0 - plates)) / 6.0), *((power_W - out_W) / 5.0)]

    plates = solve_ivp(slope, (0, time_s[-1]), np.full(4, 20.0), t_eval=time_s, max_step=2.0).y[:2]
    read = dict(zip(("a_degC", "b_degC"), plates + draw.normal(0, 0.05, plates.shape)))
    heaters = dict(zip(("heater1_frac", "heater2_frac"), shares))
    trace = Trace("plates", time_s, {**read, **heaters, "ambient_degC": np.full(900, 20.0)})
    circuit = forward(in_air("a b", 100, 5))
    found = eliminate_backward(bare_fit(GreyBox.of(circuit), records(trace, circuit.inputs, list(read), 2.0)))
    heats = [each for each in found.model.mechanisms if each.cause == "heat_source"]
    largest = [(each.key[2], *max(zip((abs(n.value) for n in each.numbers), each.places))) for each in heats]
    # some of a heater's may go to both, as a path leads there; a hundredth of its heat is how its steps are simulated
    most = {driver: place for driver, size_W, place in largest if size_W > 0.08}
    assert most == {"heater1_frac": "a_mass", "heater2_frac": "b_mass"}, (seed, most)
    assert found.rmse_degC < 0.1, seed


def test_a_power_that_hardly_moves_heats_all_the_same(circuit, simulated):
    """Constant heat fits as well, and is wrong as soon as the power changes."""
    draw = np.random.default_rng()
    power_W = draw.uniform(1.0, 5.0)
    trace = simulated(int(draw.integers(1 << 30)), heat_W=power_W)
    logged = power_W * (1 + draw.normal(0, 0.0005, len(trace.time_s)))
    found = diagnose(circuit, [replace(trace, columns={**trace.columns, "chip_power_W": logged})])
    assert found.verdict_cause.signal == "chip_power_W", trace.path


def test_only_a_body_carries_what_acts_on_it(circuit, simulated, recorded):
    trace = simulated(4)
    panel = {**trace.columns, "panel_degC": np.full(len(trace.time_s), 21.0)}  # a boundary, though it never moves
    context = Context(bare_fit(GreyBox.of(circuit), recorded(replace(trace, columns=panel))))
    beside = context.fitted.model.with_mechanism(heat("sun_W_m2", 0.1)).with_mechanism(next(path.candidates(context)))
    assert not beside.carries(0)
    behind = context.fitted.model.with_mechanism(next(mass.candidates(context)))
    second = replace(heat("sun_W_m2", 0.1), places=("board_mass",))
    assert behind.with_mechanism(second).carries(0)


@pytest.mark.parametrize(("second", "heated"), [("board", "board_mass_2"), ("board_mass", "board_mass_mass")])
def test_a_body_goes_with_what_acts_behind_it_or_beside_it(circuit, simulated, recorded, second, heated):
    """Heat in another body has no place where the first is left out."""
    bare = bare_fit(GreyBox.of(circuit), recorded(simulated(4)))
    body = next(mass.candidates(Context(bare)))
    model = bare.model.with_mechanism(body).with_mechanism(replace(body, places=(second,)))
    model = model.with_mechanism(replace(heat("sun_W_m2", 0.1), places=(heated,)))
    steps = steps_to(bare, fit(model, bare.records, most=2, prior=bare.prior), 1)
    assert {each.chosen.mechanism.key for each in steps} == {each.key for each in model.mechanisms}
    assert any(each.before.model == bare.model for each in steps)


def test_nothing_acts_on_what_melts(circuit, simulated, recorded):
    """No circuit file can say so."""
    numbers = (Number(name, unit, 1.0, log=True) for name, unit in (("G", "W/K"), ("lag", "s"), ("fusion", "K")))
    bare = bare_fit(GreyBox.of(circuit), recorded(simulated(5)))
    frozen = Context(replace(bare, model=bare.model.with_mechanism(Latent(("board",), tuple(numbers)))))
    assert frozen.network.nodes[1:] == ["board_phase"]
    assert not any("board_phase" in each.places for each in permanent_candidates(frozen, lambda each: None))
