"""The compressed problem is the problem: the same residuals and inner products as sample by sample, the slow way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.structure import linearise, project
from ambient_trainer.lti.discretise import discretised

from ..conftest import rest, run_loop

CIRCUITS = (
    "model1_kirchhoff",
    "model1_ss",
    "model2_ss",
    "model2_ss_free_cd",
    "model2_ss_single_input",
    "linear_combined",
)


def _segments(m, q, lengths=(120, 70), periods_s=(1.0, 1.0), seed=0, level=25.0):
    """Wandering inputs and outputs of nothing in particular, some missing, not the same in each output."""
    random = np.random.default_rng(seed)
    found = []
    for length, period_s in zip(lengths, periods_s):
        u = level + np.cumsum(random.normal(size=(m, length)), axis=1)
        y = u.mean(axis=0) - 3 + random.normal(size=(q, length))
        for row in range(q):
            y[row, random.choice(length, 7 + 3 * row, replace=False)] = np.nan
        found.append(Segment(period_s, u, y))
    return found


def _assert_simulated(structure, theta):
    """What weights give is what the system does from rest, and each segment's start decays, step by step."""
    beta = np.random.default_rng(5).normal(size=len(structure.linear.names))
    circuit = getattr(structure, "circuit", None)
    found = structure.system(theta, beta), structure.system(theta, np.zeros(len(beta)))
    starts = np.zeros((len(structure.segments), len(found[0].A)))
    if circuit and structure.free_start:
        starts = beta[len(structure.linear_parameters) :].reshape(starts.shape)
    for index, (segment, start) in enumerate(zip(structure.segments, starts)):
        u, hold = segment.inputs, circuit.hold if circuit else "first-order"
        system, bare = (discretised(each, segment.period_s, hold) for each in found)
        decay = run_loop(replace(bare, offset=np.zeros_like(bare.offset)), np.zeros_like(u), start)
        looped = run_loop(system, u, rest(system, u[:, 0])) + decay
        predicted = structure.predicted(theta, beta, index)
        np.testing.assert_allclose(predicted, looped, rtol=1e-9, atol=1e-9 * np.abs(looped).max())


def _square(structure, theta):
    """What the best weights leave, over all samples with an output; ``lsq_linear`` where bounds hold."""
    y = np.concatenate([segment.outputs.ravel() for segment in structure.segments])
    found = [structure.regressors(theta, index) for index in range(len(structure.segments))]
    fixed = np.concatenate([each[0].ravel() for each in found])
    free = np.concatenate([each[1].reshape(len(each[1]), each[0].size).T for each in found])
    known = ~np.isnan(y)
    target, F = (y - fixed)[known], free[known]
    low, high = structure.linear.low, structure.linear.high
    scale = np.linalg.norm(F, axis=0)
    scale[scale == 0] = 1.0
    beta = np.linalg.lstsq(F / scale, target, rcond=1e-12)[0] / scale
    if len(low) == len(beta) and ((beta < low).any() or (beta > high).any()):
        beta = lsq_linear(F, target, (low, high), method="bvls", tol=1e-14).x
    return float(np.sum((target - F @ beta) ** 2))


def _assert_same(structure, theta, tolerance=1e-6):
    """|r| and J'r of the compressed problem against those of the residual of every sample."""
    _assert_simulated(structure, theta)
    found = project(structure, theta)
    square = _square(structure, theta)
    assert found.residual @ found.residual == pytest.approx(square, rel=1e-9)
    if not len(theta):
        return
    h = 3e-4
    at = [[_square(structure, theta + k * h * e) for k in (-2, -1, 1, 2)] for e in np.eye(len(theta))]
    gradient = np.array([(a - 8 * b + 8 * c - d) / (12 * h) for a, b, c, d in at])
    # a column that is zero but for the rounding of differences is compared with the longest
    length = np.linalg.norm(found.jacobian, axis=0)
    length = np.maximum(length, 1e-4 * length.max()) * np.sqrt(square)
    np.testing.assert_allclose(2 * found.jacobian.T @ found.residual / length, gradient / length, atol=tolerance)


def _somewhere(structure, seed):
    """A theta whose time constants are tens of seconds, each resistance and capacitance off its initial value."""
    random = np.random.default_rng(seed)
    theta = structure.search.initial + random.uniform(-0.5, 0.5, len(structure.search.initial))
    capacities = {node.capacitance for node in structure.circuit.states}
    theta += [3.0 if name in capacities else 0.0 for name in structure.search.names]
    return theta


@pytest.mark.parametrize("name", CIRCUITS)
def test_a_circuit_from_equilibrium(name):
    circuit = load_circuit(name)
    structure = CircuitStructure(circuit, _segments(len(circuit.inputs), 1, periods_s=(1.0, 0.5)))
    _assert_same(structure, _somewhere(structure, 1))


def test_weights_at_their_bounds_are_held_there():
    """An output that is beyond the hottest input wants weights above 1 and below 0."""
    circuit = load_circuit("model2_ss")
    segments = [replace(each, outputs=each.outputs + 8 * (each.inputs[0] - each.inputs[1])) for each in _segments(4, 1)]
    structure = CircuitStructure(circuit, segments)
    theta = _somewhere(structure, 1)
    found = project(structure, theta)
    assert (found.beta == 0).any()
    assert (found.beta == 1).any()
    _assert_same(structure, theta)


@pytest.mark.parametrize("apart", [0.0, 0.9e-3, 1.1e-3])
def test_modes_that_lie_close(apart, forward):
    """Three nodes that only see the ambient, with rates that differ by ``apart`` or not at all; each kind of start."""
    for free_start, circuit in ((False, load_circuit("model2_ss_free_cd")), (True, forward)):
        structure = CircuitStructure(circuit, _segments(len(circuit.inputs), len(circuit.outputs)))
        theta = np.log([20.0 if name.startswith("C_") else 2.0 for name in structure.search.names])
        if free_start:
            theta[[name in ("R_ab", "R_bc", "R_ac") for name in structure.search.names]] += np.log(1e9)
        theta[structure.search.names.index("C_b" if free_start else "C_battery")] += apart
        _assert_same(structure, theta, tolerance=1e-5)


def test_source_shares_are_searched_and_weights_are_solved_beside_free_starts(forward):
    """Every kind of unknown in one circuit: logarithmic, plain, weight, offset and start."""
    share, weight = (replace(forward.parameters[0], name=name, unit="1", initial=1.0, low=-9.0, high=9.0)
                     for name in ("share", "weight"))  # fmt: skip
    offset = replace(weight, name="offset", initial=0.0)
    outputs = (
        replace(forward.outputs[0], states={"a": "weight", "b": "weight"}, inputs={"ambient_degC": "w_ambient"}),
        replace(forward.outputs[1], offset="offset"),
    )
    circuit = replace(
        forward,
        sources=(replace(forward.sources[0], share="share"),),
        outputs=outputs,
        hold="first-order",
        parameters=(*forward.parameters, share, weight, offset, replace(weight, name="w_ambient")),
    )
    structure = CircuitStructure(circuit, _segments(2, 2, periods_s=(1.0, 0.5)))
    assert structure.search.names[-1] == "share"
    assert structure.linear.names[:3] == ("weight", "offset", "w_ambient")
    assert "share" not in structure.logarithmic_names
    _assert_same(structure, _somewhere(structure, 3) - np.array([3.0] * 3 + [0.0] * 7))


@pytest.mark.parametrize(
    "theta",
    [
        *(np.log([0.07]), np.log([0.3, 2.0, 0.05, 1.5]), np.log([0.15, 0.35, 0.04, 0.35])),
        *(np.log([0.15, zeta, 0.02]) for zeta in (0.35, 1.0, 6.0)),
    ],
    ids=["one pole", "four poles", "two damped pairs", "damped pair", "double pole", "two real poles"],
)
def test_a_free_filter(theta):
    structure = FreeFilter(len(theta), _segments(2, 1))
    _assert_same(structure, theta, tolerance=1e-5)
    poles = np.linalg.eigvals(structure.system(theta, np.ones(len(structure.linear.names))).A)
    # a double pole splits by the root of the rounding error
    np.testing.assert_allclose(_poles(structure, theta), np.sort_complex(poles), rtol=1e-6)


def test_inputs_that_say_nothing_the_same_or_on_other_scales():
    """The gains share what one input says, those of a dead one are 0, and the residual is the same."""
    [whole] = _segments(2, 1, lengths=(120,), periods_s=(1.0,))
    a, b = whole.inputs
    plain = project(FreeFilter(1, [whole]), np.log([0.07]))
    other = replace(whole, inputs=np.array([a, 1e-7 * b, np.zeros(120), a]))
    found = project(FreeFilter(1, [other]), np.log([0.07]))
    assert found.residual @ found.residual == pytest.approx(plain.residual @ plain.residual)
    np.testing.assert_allclose(np.abs(found.jacobian.T @ found.residual), np.abs(plain.jacobian.T @ plain.residual))
    gains, wanted = found.beta[:4], plain.beta[:2]
    np.testing.assert_allclose(gains, [wanted[0] / 2, 1e7 * wanted[1], 0.0, wanted[0] / 2], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("there", [slice(None), slice(8990, 9000), slice(0, 3), slice(5000, 5100)])
def test_long_segments_are_compressed_in_blocks(there):
    """Blocks and a rest have the inner products of the whole; some may hold nothing, or fewer samples than signals."""
    [whole] = _segments(4, 1, lengths=(9000,), periods_s=(1.0,))
    outputs = np.full_like(whole.outputs, np.nan)
    outputs[:, there] = whole.outputs[:, there]
    structure = CircuitStructure(load_circuit("model2_ss_free_cd"), [replace(whole, outputs=outputs)])
    theta = _somewhere(structure, 4)
    problem = linearise(structure, theta)
    known = ~np.isnan(outputs[0])
    free, target = structure.regressors(theta, 0)[1][:, 0, known].T, outputs[0, known]
    np.testing.assert_allclose(problem.free.T @ problem.free, free.T @ free, rtol=1e-9)
    np.testing.assert_allclose(problem.free.T @ problem.target, free.T @ target, rtol=1e-9)
    assert problem.target @ problem.target == pytest.approx(target @ target)


def _slope_by_differences(structure, theta, h=3e-6):
    around = [(structure.penalty(theta + h * e)[0], structure.penalty(theta - h * e)[0]) for e in np.eye(len(theta))]
    return np.array([(above - below) / (2 * h) for above, below in around]).T


def test_a_time_constant_beyond_all_data_is_penalised():
    structure = CircuitStructure(load_circuit("model2_ss_free_cd"), _segments(4, 1))
    theta = _somewhere(structure, 5)
    names = structure.search.names
    theta[names.index("C_flash")] += 6.0
    theta[names.index("C_battery")] -= 9.0
    theta[names.index("R_usb_ambient")] += 9.0
    penalty, slope = structure.penalty(theta)
    values = structure.values(theta, np.zeros(7))
    taus = [values[f"C_{node}"] * values[f"R_{node}_ambient"] for node in ("flash", "battery", "usb")]
    slow, fast = np.log(np.array(taus) / 120), np.log(0.1 / np.array(taus))
    # per mode, in the order of their rates; here every node is a mode of its own
    np.testing.assert_allclose(np.sort(penalty[:3]), np.sort(np.maximum(slow, 0)), atol=1e-9)
    np.testing.assert_allclose(np.sort(penalty[3:]), np.sort(np.maximum(fast, 0)), atol=1e-9)
    assert (np.count_nonzero(penalty[:3]), np.count_nonzero(penalty[3:])) == (2, 1)
    np.testing.assert_allclose(slope, _slope_by_differences(structure, theta, 1e-6), atol=1e-8)


def test_a_mode_of_two_nodes_that_lose_nothing_together_is_penalised():
    """Battery and usb exchange quickly and lose almost nothing: each node alone looks fast."""
    structure = CircuitStructure(load_circuit("model2_ss_single_input"), _segments(1, 1))
    theta = structure.search.initial.copy()
    theta[structure.search.names.index("R_display_battery")] += 13.0
    penalty, slope = structure.penalty(theta)
    (slow,) = penalty[:3][penalty[:3] > 0]
    rate = -np.linalg.eigvals(structure.system(theta, np.zeros(0)).A).real.max()
    assert slow == pytest.approx(-np.log(rate * 120), abs=1e-6)
    np.testing.assert_allclose(slope, _slope_by_differences(structure, theta, 1e-5), atol=1e-4)


def _poles(structure, theta):
    pairs = np.exp(theta[: 2 * structure.pairs]).reshape(-1, 2)
    roots = [np.roots([1.0, 2 * zeta * omega, omega**2]) for omega, zeta in pairs]
    return np.sort_complex(np.concatenate([*roots, -np.exp(theta[2 * structure.pairs :])]))


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_regrouping_keeps_the_poles(order):
    structure = FreeFilter(order, _segments(2, 1, lengths=(2000,), periods_s=(1.0,)))
    random = np.random.default_rng(order)
    for _ in range(20):
        theta = structure.random_start(random)
        again = structure.regrouped(theta)
        np.testing.assert_allclose(_poles(structure, again), _poles(structure, theta), rtol=1e-6)


def test_a_pole_that_the_data_hardly_show_is_penalised():
    """The slowest pole of a section against a tenth of the 2000 s of data, and its slope by differences."""
    structure = FreeFilter(4, _segments(2, 1, lengths=(2000,), periods_s=(1.0,)))
    theta = np.log([0.02, 6.0, 0.05, 1.5])
    penalty, slope = structure.penalty(theta)
    slowest = 0.02 * (6 - np.sqrt(35))
    np.testing.assert_allclose(penalty, [np.log(1 / 200 / slowest), 0], atol=1e-12)
    np.testing.assert_allclose(slope, _slope_by_differences(structure, theta), atol=1e-7)
