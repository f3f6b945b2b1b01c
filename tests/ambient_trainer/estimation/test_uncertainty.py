"""Intervals cover the truth as often as they say, and what the data cannot tell is named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_trainer.circuits.addition import started
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.search import Solution, search
from ambient_trainer.estimation.uncertainty import autocorrelation_time, residuals, uncertainty

from ..conftest import in_air, response_of, rise_inputs, truth_of

FITS = 200
SAMPLES = 2000


def _noise(random, shape, phi):
    """Noise of 0.1 degC innovations and an autocorrelation of phi^lag, from its stationary distribution."""
    white = random.normal(size=(shape[0], shape[1] + 200)) * 0.1
    return lfilter([1.0], [1.0, -phi], white, axis=1)[:, 200:]


def _rise_outputs(circuit):
    u = rise_inputs(np.random.default_rng(2), SAMPLES)
    return truth_of(circuit), u, response_of(circuit, u)


def _covered(structure_of, truth, u, y, phi):
    """Per unknown how often its 95 % interval covers the truth, and the mean of the errors in standard errors.

    Where noise drives a weight to its bound there is no interval; that must be rare.
    """
    inside, scores = [], []
    for seed in range(FITS):
        noise = _noise(np.random.default_rng(1000 + seed), y.shape, phi)
        structure = structure_of([Segment(1.0, u, y + noise)])
        best = search(structure, 1, 0).best
        known = uncertainty(structure, best)
        logarithmic = structure.logarithmic_names
        weights = [name for name in structure.linear.names if name in truth]
        wanted = [np.log(truth[name]) if name in logarithmic else truth[name] for name in structure.search.names]
        wanted += [truth[name] for name in weights]
        found = np.concatenate([best.theta, best.beta[: len(weights)]])
        scores.append((found - wanted) / known.standard_error[: len(found)])
        inside.append(np.abs(scores[-1]) < known.quantile)
    told = np.isfinite(scores)
    assert told.mean(axis=0).min() > 0.98
    return np.sum(inside, axis=0) / told.sum(axis=0), np.nanmean(scores, axis=0)


SLOW = [pytest.param(0.0, id="white", marks=pytest.mark.slow), pytest.param(0.9, id="AR(1)", marks=pytest.mark.slow)]


@pytest.mark.parametrize("phi", SLOW)
def test_intervals_of_a_rise_circuit_cover_the_truth(rise, phi):
    covered, bias = _covered(lambda segments: CircuitStructure(rise, segments), *_rise_outputs(rise), phi)
    assert ((covered >= 0.90) & (covered <= 0.99)).all(), covered
    assert (np.abs(bias) < 0.5).all()


def test_white_errors_give_the_textbook_covariance(rise):
    """With white residuals the sandwich is sigma^2 (J'J)^-1, J by differences of plain simulations."""
    _, u, y = _rise_outputs(rise)
    noise = _noise(np.random.default_rng(0), y.shape, 0.0)
    structure = CircuitStructure(rise, [Segment(1.0, u, y + noise)])
    best = search(structure, 1, 0).best
    known = uncertainty(structure, best)
    unknowns = np.concatenate([best.theta, best.beta])
    P = len(best.theta)

    def outputs(values):
        return response_of(rise, u, values=structure.values(values[:P], values[P:]))[0]

    h = 1e-5
    J = np.array([(outputs(unknowns + h * e) - outputs(unknowns - h * e)) / (2 * h) for e in np.eye(len(unknowns))]).T
    error = (y + noise)[0] - outputs(unknowns)
    covariance = np.linalg.inv(J.T @ J) * (error @ error) / (SAMPLES - len(unknowns))
    np.testing.assert_allclose(known.standard_error, np.sqrt(np.diag(covariance)), rtol=0.08)
    np.testing.assert_allclose(residuals(structure, best)[0][0], error, atol=1e-9)
    assert known.residual_memory_samples < 1.3
    assert known.quantile == pytest.approx(1.961, abs=0.001)


def test_a_second_sensor_that_errs_as_the_first_says_nothing_more():
    u = 20 + np.cumsum(np.random.default_rng(1).normal(size=(1, 1000)), axis=1)
    found = []
    for names in ("a", "a b"):
        bodies = started(in_air(names, 50, 5), {}, {"C_a", "C_b", "R_b"})
        bodies = replace(bodies, edges=tuple(replace(each, resistance="R_a") for each in bodies.edges))
        y = response_of(bodies, u) + np.random.default_rng(2).normal(size=1000)
        structure = CircuitStructure(bodies, [Segment(1.0, u, y)])
        found.append(uncertainty(structure, search(structure, 1, 0).best).standard_error[0])
    assert found[1] == pytest.approx(found[0], rel=0.01)


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, 0.97])
def test_the_memory_of_an_autoregression(phi):
    """(1 + phi)/(1 - phi), the sum of phi^|lag| over all lags."""
    found = [autocorrelation_time(_noise(np.random.default_rng(seed), (1, 20000), phi)[0]) for seed in range(10)]
    assert np.mean(found) == pytest.approx((1 + phi) / (1 - phi), rel=0.12)


RESISTANCES = {
    "R_flash_ambient": 12.0,
    "R_battery_ambient": 35.0,
    "R_usb_ambient": 8.0,
    "R_display_flash": 9.5,
    "R_display_battery": 4.0,
    "R_battery_usb": 11.0,
}
CAPACITANCES = {"C_flash": 10.0, "C_battery": 30.0, "C_usb": 5.0}
WEIGHTS = {"w1": 0.3, "w2": 0.2, "w3": 0.4}


def _known(circuit, weights):
    """The uncertainty at the parameters that made the data: identifiability is asked there, not where a search ends."""
    truth = {**RESISTANCES, **CAPACITANCES, **weights}
    # what a circuit of the thesis makes of wandering sensors
    u = 25 + np.cumsum(np.random.default_rng(5).normal(size=(len(circuit.inputs), 4000)), axis=1) * 0.3
    y = response_of(circuit, u, values=truth)
    structure = CircuitStructure(circuit, [Segment(1.0, u, y + np.random.default_rng(6).normal(size=y.shape) * 0.1)])
    theta = np.array([np.log(truth[name]) for name in structure.search.names])
    beta = np.array([truth[name] for name in structure.linear.names])
    return uncertainty(structure, Solution(theta, beta, 0.0, 0.0, True, 0))


def test_model2_ss_with_everything_free_is_not_identifiable():
    """Section 5.5: nine resistances and capacitances, of which the output shows six combinations.

    With G the sum of the conductances to the ambient, C_i B_ij = 1/(R_i,ambient G R_ij C_i): the three rates
    1/(R_i,ambient C_i) show, and the three products G R_ij.
    """
    known = _known(load_circuit("model2_ss"), WEIGHTS)
    assert len(known.confounded) == 3
    assert {name for group in known.confounded for name in group} == {*RESISTANCES, *CAPACITANCES}
    told = dict(zip(known.names, known.identifiable))
    assert not any(told[name] for name in (*RESISTANCES, *CAPACITANCES))
    assert all(told[name] for name in WEIGHTS)
    errors = dict(zip(known.names, known.standard_error))
    assert all(np.isnan(errors[name]) for name in (*RESISTANCES, *CAPACITANCES))
    assert all(errors[name] < 0.1 for name in WEIGHTS)


def test_an_unknown_at_its_bound_has_no_interval_and_hides_nothing():
    known = _known(started(load_circuit("model2_ss"), CAPACITANCES, CAPACITANCES), {**WEIGHTS, "w2": 0.0})
    index = known.names.index("w2")
    assert known.confounded == ()
    assert known.at_bound.nonzero()[0].tolist() == [index]
    assert np.isnan(known.standard_error[index])
    assert np.isfinite(np.delete(known.standard_error, index)).all()


def test_too_few_independent_samples_give_no_interval(rise):
    _, u, y = _rise_outputs(rise)
    noise = _noise(np.random.default_rng(3), y.shape, 0.9)
    structure = CircuitStructure(rise, [Segment(1.0, u[:, :80], (y + noise)[:, :80])])
    known = uncertainty(structure, search(structure, 1, 0).best)
    assert known.residual_memory_samples > 3
    assert np.isnan(known.standard_error).all()
