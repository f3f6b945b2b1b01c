"""An observer from log to model file, scored on other logs of the same device through the file."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.codec import decode, encode
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.search import Cancelled, Progress
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.estimators.report import report_of
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.report import Finding
from refusals import refused

from .conftest import logged

EFFORT = Effort(seed=0)


@pytest.fixture(scope="session")
def fitted(brick_log, observer_file):
    """The brick's observer, and the calls of its progress."""
    calls = []
    fit = estimator(observer_file).fit([brick_log], EFFORT, lambda *call: calls.append(call))
    return fit, calls


@pytest.fixture(scope="session")
def model(fitted):
    return model_of(fitted[0], [], {})


def test_the_file_holds_all_that_a_device_needs(fitted, model):
    fit, _ = fitted
    assert decode(encode(model).encode(), "brick.json") == model
    assert [each.name for each in model.main.inputs] == ["chip", "board", "shell"]
    assert set(model.fallbacks) == {"chip", "board", "shell"}
    for name, fallback in model.fallbacks.items():
        assert name not in [each.name for each in fallback.inputs]
    everyone = [model.main, model.secondary.estimator, *model.fallbacks.values()]
    assert all(len(each.states) == 4 for each in everyone)
    assert all([one.period_s for one in each.discrete] == [0.1, 0.2, 0.5, 1.0, 5.0] for each in everyone)
    assert model.secondary.threshold_degC == fit.secondary.threshold_degC
    lags = [(term.of, term.lag_s) for term in model.error_variance.terms]
    assert lags == [("movement", 300.0), ("guard_above", 60.0), ("guard_below", 60.0)]
    low, high = model.error_variance.quantiles[90]
    assert low == -high < 0


@pytest.fixture(scope="session")
def free(brick_log):
    """The free filter of as many states, fitted to the same log."""
    columns = ("chip_degC", "board_degC", "shell_degC")
    return model_of(FreeFilterEstimator(4).fit([brick_log], Effort(starts=2), None, None, columns), [], {})


def test_unseen_logs_are_estimated_as_well_as_by_the_free_filter_and_inside_the_interval(model, free):
    unseen = [logged(seed, 4.0) for seed in (11, 12)]
    found = [evaluate_trace(model, each) for each in unseen]
    for each, trace in zip(found, unseen):
        assert each.metrics.rmse_degC < 1.05 * evaluate_trace(free, trace).metrics.rmse_degC
    held = np.average([each.coverage[90] for each in found], weights=[each.scored for each in found])
    assert 0.87 < held < 0.96


def test_heat_that_nobody_logs_is_seen_by_the_guard(model, free):
    """A watt into the board that no log tells of: filters that never saw such heat take it for the ambient."""
    odd = logged(14, 4.0, unlogged_W=1.0)
    guarded = evaluate_trace(model, odd)
    for each in (model._replace(secondary=None, error_variance=None), free):
        assert guarded.metrics.rmse_degC < 0.3 * evaluate_trace(each, odd).metrics.rmse_degC
    assert "degraded" in guarded.status


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda log: log.cut(None, 4500.0), "900 samples"),
        (lambda log: without(log, "chip_power_W"), "'chip_power_W'"),
        (lambda log: replace(log, columns={**log.columns, "cpu_load_frac": 0 * log.time_s}), "column cpu_load_frac"),
    ],
)
def test_a_log_that_lacks_something_is_refused_before_anything_is_searched(change, place, observer_file, brick_log):
    assert place in str(refused(estimator(observer_file).fit, [change(brick_log)], *cancelled(0)))


def without(log: Trace, name: str) -> Trace:
    return replace(log, columns={key: values for key, values in log.columns.items() if key != name})


def test_the_observer_is_not_fitted_to_gaps(observer_file, brick_log, fitted):
    """A minute without a reference and ten without a sensor move the fit a little, and break nothing."""
    columns = {name: values.copy() for name, values in brick_log.columns.items()}
    columns["ambient_degC"][1000:1006] = np.nan
    columns["board_degC"][2500:2620] = np.nan
    fit = estimator(observer_file).fit([Trace("gaps", brick_log.time_s, columns)], EFFORT)
    assert fit.samples == fitted[0].samples - 120
    assert fit.rmse_degC == pytest.approx(fitted[0].rmse_degC, rel=0.2)


def cancelled(stage: int) -> tuple[Effort, Progress]:
    effort = Effort(seed=0)

    def told(number: int, evaluation: int, square: float) -> None:
        if (number, evaluation) == (stage, 5):
            effort.budget.cancel()

    return effort, told


def test_ctrl_c_leaves_out_the_fallbacks_that_are_not_found_yet(observer_file, brick_log, fitted):
    fit = estimator(observer_file).fit([brick_log], *cancelled(4))
    assert fit.stopped
    assert not fit.converged
    assert list(fit.fallbacks) == ["chip"]
    assert fit.rmse_degC == fitted[0].rmse_degC
    assert any(each.status == "warning" for each in report_of(fit).lead if isinstance(each, Finding))
    assert list(model_of(fit, [], {}).fallbacks) == ["chip"]


@pytest.mark.parametrize("stage", [0, 1])
def test_before_main_and_guard_are_found_there_is_nothing_to_keep(stage, observer_file, brick_log):
    with pytest.raises(Cancelled):
        estimator(observer_file).fit([brick_log], *cancelled(stage))
