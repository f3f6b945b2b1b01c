"""Resistance against capacitance comes out of the two-sided circuits, and known capacitances cure it."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.circuits.addition import started
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Trace, save_trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.evaluation import identifiability as identifiability_module
from ambient_trainer.evaluation.identifiability import identifiability, own_output, recovered, reestimates, unknowns_at
from ambient_trainer.evaluation.identifiability_report import report_of
from ambient_trainer.evaluation.sensitivity import sensitivity

TRUTH = {
    "C_flash": 4.0, "C_battery": 60.0, "C_usb": 6.0,
    "R_flash_ambient": 40.0, "R_battery_ambient": 20.0, "R_usb_ambient": 30.0,
    "R_display_flash": 15.0, "R_display_battery": 6.0, "R_soc_flash": 60.0, "R_soc_battery": 25.0,
    "R_battery_usb": 25.0, "w1": 0.3, "w2": 0.2, "w3": 0.5,
}  # fmt: skip
CAPACITANCES = ("C_flash", "C_battery", "C_usb")
NOISE_DEGC = 0.05


def quiet(what, done, total):
    assert 0 <= done <= total


def inputs_of(columns, samples=4000, period_s=5.0):
    """Sensors that move by themselves: each a ramp between levels of its own, in a few minutes or in half an hour."""
    random = np.random.default_rng(8)
    rows = []
    for index in range(len(columns)):
        knots = np.arange(0, samples + 1, (60, 240, 25, 400, 90)[index])
        rows.append(np.interp(np.arange(samples), knots, random.uniform(10, 60, len(knots))))
    return Segment(period_s, np.array(rows), np.zeros((1, samples)))


def subject(name, fixed=()):
    """The circuit at the truth with its own output, and what can be known of it."""
    circuit = load_circuit(name)
    values = {each.name: TRUTH[each.name] if each.free else each.initial for each in circuit.parameters}
    circuit = started(circuit, {each: values[each] for each in fixed}, fixed)
    found = own_output(circuit, values, [inputs_of(circuit.inputs)], NOISE_DEGC, 1.0)
    structure = found.structure({})
    return found, sensitivity(structure, *unknowns_at(structure, values))


@pytest.mark.parametrize("name", ["model1_ss", "model2_ss"])
def test_resistance_against_capacitance_comes_out_by_name(name):
    """And by simulation at another truth: scaling along the symmetry gives the same output."""
    found, known = subject(name)
    hot = "soc" if name == "model1_ss" else "display"
    resistances = ("flash_ambient", "battery_ambient", "usb_ambient", f"{hot}_flash", f"{hot}_battery", "battery_usb")
    scaling = {**dict.fromkeys(CAPACITANCES, 1.0), **{f"R_{each}": -1.0 for each in resistances}}
    assert known.symmetries == (scaling,)
    assert known.blind_directions == 3  # the shares of eq. 4.11 give two more, that bend
    assert set(known.mixed) == set(scaling)
    time_constants = [{f"C_{node}": 1.0, f"R_{node}_ambient": 1.0} for node in ("flash", "battery", "usb")]
    assert [each for each in known.products if each in time_constants] == time_constants
    assert len(known.products) == 5
    assert np.count_nonzero(np.array(known.singular_values_degC) > 1e-6) == 9
    scaled = {each: value * 1.7 ** scaling.get(each, 0.0) for each, value in found.values.items()}
    again = own_output(found.circuit, scaled, [inputs_of(found.circuit.inputs)], NOISE_DEGC, 1.0)
    np.testing.assert_allclose(again.own[0].outputs, found.own[0].outputs, atol=1e-8)


def test_fixed_capacitances_cure_it():
    found, known = subject("model1_ss", CAPACITANCES)
    assert known.blind_directions == 0
    assert known.symmetries == known.products == known.mixed == ()
    ends = reestimates(found, known, Effort(8, 0), quiet)
    assert not any(each.another() for each in ends)
    back = [each for each in ends if each.fit_percent > 99.99]
    assert len(back) >= 4
    assert all(max(each.moved.values()) < 1e-3 for each in back)


def test_the_thesis_test_finds_other_sets_with_the_same_output():
    found, known = subject("model2_ss")
    others = [each for each in reestimates(found, known, Effort(8, 0), quiet) if each.another()]
    assert len(others) >= 2
    for each in others:
        values = {**found.values, **each.values}
        again = own_output(found.circuit, values, [inputs_of(found.circuit.inputs)], NOISE_DEGC, 1.0)
        error = again.own[0].outputs - found.own[0].outputs
        fit = 100 * (1 - np.linalg.norm(error) / np.linalg.norm(found.own[0].outputs - found.own[0].outputs.mean()))
        assert fit == pytest.approx(each.fit_percent, abs=1e-3)
        for node in ("flash", "battery", "usb"):
            known_product = values[f"C_{node}"] * values[f"R_{node}_ambient"]
            assert known_product == pytest.approx(TRUTH[f"C_{node}"] * TRUTH[f"R_{node}_ambient"], rel=0.02)


@pytest.mark.parametrize("name", ["model1_ss_single_input", "model2_ss_single_input"])
def test_single_input_circuits_keep_the_scale_of_their_losses(name):
    """Erratum 10: only ratios of the resistances to the ambient enter, whatever is known of the capacitances."""
    _, known = subject(name)
    losses = {f"R_{node}_ambient": 1.0 for node in ("flash", "battery", "usb")}
    hot = "soc" if name == "model1_ss_single_input" else "display"
    exchange = {"C_battery": 1.0, "C_usb": 1.0, f"R_{hot}_battery": -1.0, "R_battery_usb": -1.0}
    assert list(known.symmetries) == [exchange, losses]
    assert known.blind_directions == 3
    _, cured = subject(name, ("C_battery", "C_usb"))
    assert cured.symmetries == (losses,)
    assert cured.blind_directions == 1
    assert subject(name, ("C_battery", "C_usb", "R_usb_ambient"))[1].blind_directions == 0


@pytest.mark.parametrize("every", [1, 20])
def test_profiles_have_the_interval_of_the_quadratic_where_the_data_tell_much(every):
    """Oracle: sigma times the root of the diagonal of (J'J)^-1, by plain simulations, where there is a reference."""
    found, _ = subject("model1_ss", CAPACITANCES)
    logged = [replace(own, outputs=np.where(np.arange(4000) % every, np.nan, own.outputs)) for own in found.own]
    found = own_output(found.circuit, found.values, logged, NOISE_DEGC, 1.0)
    structure = found.structure({})
    theta, beta = unknowns_at(structure, found.values)
    unknowns, h = np.concatenate([theta, beta]), 1e-5

    def outputs(at):
        values = structure.values(at[: len(theta)], at[len(theta) :])
        return own_output(found.circuit, values, found.own, NOISE_DEGC, 1.0).own[0].outputs[0]

    J = np.array([(outputs(unknowns + h * e) - outputs(unknowns - h * e)) / (2 * h) for e in np.eye(len(unknowns))]).T
    width = np.sqrt(
        np.diag(np.linalg.inv(J[::every].T @ J[::every])) * NOISE_DEGC**2 * identifiability_module.THRESHOLD
    )
    index = structure.search.names.index("R_soc_battery")
    got = identifiability_module.profile(found, "R_soc_battery")
    assert not got.flat
    assert np.log(got.interval95[1] / got.interval95[0]) / 2 == pytest.approx(width[index], rel=0.1)
    assert list(got.values) == sorted(got.values)
    assert min(got.deviances) == 0.0


def test_the_mean_of_noisy_replicates_is_within_two_standard_errors_and_what_is_confounded_is_not_said():
    found, known = subject("model2_ss", CAPACITANCES)
    back = recovered(found, known, 40, 5, quiet)
    assert {each.name for each in back} == {each.name for each in found.circuit.parameters if each.free}
    assert max(abs(each.standard_errors_off) for each in back) < 2
    for each in back:
        assert each.mean == pytest.approx(each.truth, rel=0.1)
    found, known = subject("model2_ss")
    assert {each.name for each in recovered(found, known, 3, 5, quiet)} == {"w1", "w2", "w3"}


@pytest.fixture(scope="module")
def trace():
    circuit = load_circuit("model2_ss")
    values = {each.name: TRUTH[each.name] for each in circuit.parameters}
    segment = inputs_of(circuit.inputs, samples=1500, period_s=10.0)
    own = own_output(circuit, values, [segment], NOISE_DEGC, 1.0).own[0]
    noise = np.random.default_rng(0).normal(0.0, NOISE_DEGC, own.outputs.shape[1])
    columns = {**dict(zip(circuit.inputs, own.inputs)), "ambient_degC": own.outputs[0] + noise}
    return Trace("made", np.arange(own.inputs.shape[1]) * 10.0, columns)


@pytest.mark.slow
def test_a_trace_tells_it_from_the_fit_on(trace):
    free = identifiability(load_circuit("model2_ss"), trace, {}, Effort(4, 0), 2, quiet)
    assert not free.identifiable
    assert free.others
    assert set(CAPACITANCES) <= set(free.flat)
    assert "not identifiable" in report_of(free).title


def test_the_command(trace, figures, tmp_path):
    path = str(tmp_path / "trace.csv")
    save_trace(path, trace)
    fixes = [part for each in CAPACITANCES for part in ("--fix", each)]
    data, printed = figures("identifiability", path, "--circuit", "model2_ss", *fixes, "--starts", 3, "--replicates", 2)
    assert "model2_ss is identifiable" in printed
    assert data["identifiable"] is True
    assert data["held"] == list(CAPACITANCES)
    assert len(data["thesis_test"]["starts"]) == 3
    assert {each["name"] for each in data["profiles"]} == set(data["values"])
