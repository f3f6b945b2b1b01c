"""All four together: what they are called, what they may see, and what they do where something is missing."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_studies.related import chau, he, ishii, li
from ambient_studies.related.methods import TRAINING_COLUMNS, related_methods
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.method import Method

Made = Callable[..., Trace]

NAMES = ["chau_linear_battery", "he_svr", "ishii_transfer_functions", "li_fixed_point"]
READ: dict[str, Sequence[str]] = dict(zip(NAMES, (chau.SENSORS, he.SENSORS, ishii.SENSORS, li.SENSORS)))


def calm(trace: Trace) -> Trace:
    """The same as a phone that is a little warmer than an ambient that drifts, its battery stable at times."""
    ambient = 20.0 + 8.0 * np.sin(trace.time_s / 4000.0)
    warmer = {name: ambient + 3.0 + 0.1 * (trace.columns[name] - 25.0) for name in ishii.SENSORS}
    return replace(trace, columns={**trace.columns, **warmer, "ambient_degC": ambient, "battery_degC": ambient + 2.0})


@pytest.fixture(scope="module")
def traces(made: Made) -> tuple[Trace, Trace]:
    return calm(made(3000, seed=1)), calm(made(1000, seed=2))


@pytest.fixture(scope="module")
def methods(traces: tuple[Trace, Trace]) -> list[Method]:
    return related_methods(*traces)


def holed(trace: Trace, column: str, *indices: int) -> Trace:
    values = trace.columns[column].copy()
    values[list(indices)] = np.nan
    return replace(trace, columns={**trace.columns, column: values})


def without(trace: Trace, *names: str) -> Trace:
    return replace(trace, columns={name: values for name, values in trace.columns.items() if name not in names})


def test_their_names(methods: list[Method]) -> None:
    assert [method.name for method in methods] == NAMES
    assert {method.variant for method in methods} == {"corrected"}
    assert all("Given: " in method.about and "Filled in: " in method.about for method in methods)
    assert not any("\n" in method.about for method in methods)


def test_they_learn_something(methods: list[Method], made: Made) -> None:
    unseen = calm(made(2000, seed=5))
    for method in methods:
        error = method.estimate(unseen) - unseen.reference
        assert np.sqrt(np.mean(error**2)) < 0.5 * unseen.reference.std(), method.name


def test_none_sees_the_reference(methods: list[Method], made: Made) -> None:
    trace = calm(made(2000, seed=5))
    random = np.random.default_rng(1)
    corrupted = replace(trace, columns={**trace.columns, "ambient_degC": random.normal(1e3, 1e3, 2000)})
    for method in methods:
        expected = method.estimate(trace)
        assert np.isfinite(expected).all(), method.name
        for other in (corrupted, without(trace, "ambient_degC")):
            assert method.estimate(other).tobytes() == expected.tobytes(), method.name


def test_none_sees_what_is_still_to_come(methods: list[Method], made: Made) -> None:
    trace = calm(made(2000, seed=5))
    for method in methods:
        whole = method.estimate(trace)
        for stop in (1, 2, 700):
            part = replace(
                trace, time_s=trace.time_s[:stop], columns={name: each[:stop] for name, each in trace.columns.items()}
            )
            assert method.estimate(part) == pytest.approx(whole[:stop], abs=1e-9), method.name


@pytest.mark.parametrize("index", range(4))
def test_a_missing_value_leaves_that_sample_without_an_estimate(methods: list[Method], made: Made, index: int) -> None:
    method, trace = methods[index], calm(made(500, seed=5))
    whole = method.estimate(trace)
    for column in trace.columns:
        found = method.estimate(holed(trace, column, 0, 77))
        missing = np.isnan(found)
        assert np.flatnonzero(missing).tolist() == ([0, 77] if column in READ[method.name] else []), column
        # what comes later is moved by a little at most: the gap is bridged by a straight line
        assert np.abs(found - whole)[200:].max() < 0.05, column


@pytest.mark.parametrize("index", range(4))
def test_without_any_value_there_is_no_estimate(methods: list[Method], made: Made, index: int) -> None:
    trace = calm(made(50, seed=5))
    empty = holed(trace, READ[methods[index].name][0], *range(50))

    assert np.isnan(methods[index].estimate(empty)).all()


@pytest.mark.parametrize("index", range(4))
def test_missing_columns_are_refused_in_one_message(methods: list[Method], made: Made, index: int) -> None:
    method = methods[index]
    bare = without(made(50, seed=5), *READ[method.name])

    with pytest.raises(Refused) as refused:
        method.estimate(bare)

    mend = f"the trace has {', '.join(bare.columns)}; log it or map it on import"
    assert [str(each) for each in refused.value.faults] == [
        f"line 1: no column '{name}'; {mend}" for name in READ[method.name]
    ]


def test_a_training_trace_without_columns_is_refused_before_any_fit(traces: tuple[Trace, Trace]) -> None:
    training, idle = traces

    with pytest.raises(Refused) as refused:
        related_methods(without(training, "display_degC", "charging_on"), idle)

    assert [fault.problem for fault in refused.value.faults] == ["no column 'charging_on'", "no column 'display_degC'"]
    assert set(TRAINING_COLUMNS) < set(training.columns)


def test_an_idle_trace_without_drives_is_refused(traces: tuple[Trace, Trace]) -> None:
    training, idle = traces

    with pytest.raises(Refused, match=r"made 2: line 1: no column 'cpu_load_frac'"):
        related_methods(training, without(idle, "cpu_load_frac"))


def test_the_same_traces_give_the_same_estimates(
    methods: list[Method], traces: tuple[Trace, Trace], made: Made
) -> None:
    unseen = calm(made(300, seed=7))
    for method, again in zip(methods, related_methods(*traces)):
        assert method.estimate(unseen).tobytes() == again.estimate(unseen).tobytes(), method.name


def test_training_samples_with_gaps_are_left_out(made: Made) -> None:
    training, idle, unseen = (calm(made(count, seed=seed)) for count, seed in [(1500, 1), (800, 2), (300, 7)])
    for offset, column in enumerate(training.columns):
        training = holed(training, column, *range(offset, 1500, 29))

    for method in related_methods(training, idle):
        assert np.isfinite(method.estimate(unseen)).all(), method.name
