"""Every estimator keeps one contract; what a user calls a circuit becomes what fits it, or is refused."""

import json
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from ambient_model.model import LEVELS_PERCENT
from ambient_model.trace import REFERENCE, split_column
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.base import Effort, Estimator, Fit
from ambient_trainer.estimators.registry import estimator, estimator_names, thermal_circuit
from ambient_trainer.estimators.report import report_of
from ambient_trainer.lti.lag import lagged
from ambient_trainer.lti.response import states
from refusals import refused

ANY = [name for name in estimator_names() if estimator(name).reads_any and estimator(name).name == name]


def made(seed: int, samples: int, names: tuple[str, ...] = ("battery", "usb")) -> Trace:
    """Sensors behind an ambient that changes, each with a lag and noise of its own, every 5 s."""
    random = np.random.default_rng(seed)
    time_s = np.arange(samples) * 5.0
    ambient = 20 + 5 * np.sin(time_s / 900) + np.cumsum(random.normal(0, 0.05, samples))
    columns = {"ambient_degC": ambient}
    for index, name in enumerate(names):
        lag, heat = 30.0 * (1 + index), np.repeat(random.uniform(0, 5, samples // 50 + 1), 50)[:samples]
        row = lagged(ambient + heat / (1 + index), lag, 5.0)
        columns[f"{name}_degC"] = row + random.normal(0, 0.02, samples)
    return Trace(f"made {seed}", time_s, columns)


def check_estimator(estimator: Estimator, training: Sequence[Trace], other: Trace) -> None:
    """Fit an estimator with one start, and test what it gives on ``other``, a trace without gaps."""
    searches: list[int] = []
    effort = Effort(starts=1)
    fit = estimator.fit(training, effort, lambda number, *_: searches.append(number))
    assert max(searches, default=0) <= estimator.searches(effort), "searches() counts the searches of a fit"
    again = estimator.fit(training, effort)
    assert again.rmse_degC == fit.rmse_degC, "two fits with one seed agree"
    assert all(name in training[0].columns for name in fit.inputs), "inputs are trace columns"
    assert REFERENCE not in fit.inputs, "the reference is no input"
    for each in (fit, *fit.fallbacks.values()):
        _check_fitted(each, other)
    for name, fallback in fit.fallbacks.items():
        read = [split_column(column)[0] for column in fallback.inputs]
        assert name not in read, f"the fallback without {name} does not read it"


def _check_fitted(fit: Fit, other: Trace) -> None:
    assert np.isfinite(fit.rmse_degC), "rmse_degC is finite"
    assert isinstance(fit.identifiable, bool), "identifiable is a bool"
    bands = [fit.interval_degC[level] for level in LEVELS_PERCENT]
    nested = all(b[0] <= a[0] <= a[1] <= b[1] for a, b in pairwise(bands))
    assert nested, "interval_degC has nested bands at 50, 90 and 98 %"
    estimate = fit.estimate_degC(other)
    assert estimate.shape == other.time_s.shape, "estimate_degC gives a value a sample"
    bare = Trace(other.path, other.time_s, {name: other.columns[name] for name in fit.inputs})
    assert np.array_equal(fit.estimate_degC(bare), estimate, equal_nan=True), "the estimate reads its inputs alone"
    half = len(other.time_s) // 2
    first = fit.estimate_degC(other.cut(None, float(other.time_s[half])))
    causal = np.allclose(first, estimate[:half], atol=1e-9, equal_nan=True)
    assert causal, "the estimate is causal: later samples do not change it"
    system = fit.discrete(float(other.time_s[1] - other.time_s[0]))
    assert np.abs(np.linalg.eigvals(system.A)).max(initial=0) < 1, "the recursion is stable"
    if fit.secondary is None:
        u = np.vstack([other.columns[name] for name in fit.inputs])
        start = np.asarray(np.linalg.solve(np.eye(len(system.A)) - system.A, system.B @ u[:, 0]), dtype=np.float64)
        x = states(system.A, system.B @ u, start)
        recursed = (system.C @ x + system.D @ u)[0] + system.offset[0]
        assert np.allclose(recursed, estimate, atol=1e-6), "the estimate is the recursion's, from equilibrium"


@pytest.mark.parametrize(
    "name", ["linear_usb", *(pytest.param(each, marks=[pytest.mark.slow] * (each == "free_observer")) for each in ANY)]
)
def test_the_contract_holds(name):
    check_estimator(estimator(name), [made(1, 160)], made(2, 80))


def test_an_unknown_name_one_of_another_kind_or_sensors_of_a_circuit_are_refused_before_any_trace_is_read():
    said = str(refused(estimator, "free-9"))
    for name in ("phone", "phone_observer", "free-1", "free-4", "circuit_observer"):
        assert f" {name}," in said
    assert thermal_circuit("model2_ss").name == "model2_ss"
    assert str(refused(thermal_circuit, "free-2")).startswith("circuit: free-2")
    assert "free-1" not in str(refused(thermal_circuit, "free-9"))
    said = str(refused(estimator, "linear_usb", ["usb_degC"]))
    for name in ("sensors", "linear_usb", "free-1", "circuit_observer", "free_observer"):
        assert name in said


@pytest.mark.parametrize("name", ["free-1", "model2_ss", "linear_combined"])
def test_the_machines_view_is_plain_json(name):
    """An unidentifiable circuit has no intervals: null, never NaN."""
    fit = estimator(name).fit([made(0, 600, ("soc", "flash", "battery", "usb", "display"))], Effort(starts=1))
    said = json.loads(json.dumps(report_of(fit).data, allow_nan=False))
    assert said["rmse_degC"] == fit.rmse_degC
    assert [each["name"] for each in said["parameters"]] == [each.name for each in fit.parameters]
    assert said["identifiable"] == fit.identifiable == (name != "model2_ss")
    gains = [said["dc_gains"][column] for column in fit.inputs]
    if fit.states:
        at_rest = fit.system.D - fit.system.C @ np.linalg.inv(fit.system.A) @ fit.system.B
        assert gains == pytest.approx(at_rest[0].tolist(), rel=1e-6, abs=1e-9)
    else:
        assert gains == fit.system.D[0].tolist()
