"""No model sees the evaluation's reference, not even for its initial state."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_studies.related.methods import related_methods
from ambient_studies.reproduce.names import MODELS, OURS, RELATED
from ambient_studies.reproduce.observers import observer_methods
from ambient_studies.thesis.methods import thesis_methods
from ambient_trainer.simulator.phone import simulate

PERIOD_S = 10.0


@pytest.fixture(scope="module")
def methods():
    training = simulate("5", seed=11, period_s=PERIOD_S)
    related = related_methods(training, simulate("1", seed=12, period_s=PERIOD_S))
    return [*thesis_methods(training), *related, *observer_methods(training, lambda what, done, total: None)]


@pytest.fixture(scope="module")
def runs():
    return [simulate(name, seed=13, period_s=PERIOD_S) for name in ("2.1", "3", "2.2")]


def corruptions(reference):
    """The reference with another first sample, shifted, made noise, and gone."""
    first = reference.copy()
    first[0] += 40.0
    noise = np.random.default_rng(0).normal(0.0, 300.0, len(reference))
    return {
        "first sample": first,
        "shifted": reference - 5.0,
        "noise": noise,
        "missing": np.full(len(reference), np.nan),
    }


def test_every_method_is_here(methods):
    assert {each.name for each in methods} == {*MODELS, *RELATED, *OURS}
    assert {each.variant for each in methods} == {
        "corrected",
        "as_printed",
        "noncausal",
        "published_parameters",
        "ours",
    }


def test_a_corrupted_reference_changes_no_bit_of_a_causal_estimate(methods, runs):
    for trace in runs:
        for method in methods:
            if method.variant == "noncausal":
                continue
            estimate = method.estimate(trace).tobytes()
            for name, values in corruptions(trace.reference).items():
                corrupted = replace(trace, columns={**trace.columns, "ambient_degC": values})
                assert method.estimate(corrupted).tobytes() == estimate, (trace.path, method.name, method.variant, name)


def test_a_causal_estimate_needs_no_reference_at_all(methods, runs):
    for trace in runs:
        blind = replace(trace, columns={k: v for k, v in trace.columns.items() if k != "ambient_degC"})
        for method in methods:
            if method.variant != "noncausal":
                assert method.estimate(blind).tobytes() == method.estimate(trace).tobytes(), method.name


def test_a_causal_estimate_knows_no_later_sample(methods, runs):
    for trace in runs:
        half = len(trace.time_s) // 2
        early = replace(
            trace, time_s=trace.time_s[:half], columns={name: values[:half] for name, values in trace.columns.items()}
        )
        for method in methods:
            if method.variant != "noncausal":
                whole, part = method.estimate(trace)[:half], method.estimate(early)
                np.testing.assert_allclose(part, whole, rtol=1e-9, atol=1e-9, err_msg=f"{method.name} {trace.path}")


def test_the_corruption_would_be_seen(methods, runs):
    (peeking,) = [each for each in methods if each.variant == "noncausal"]
    for trace in runs:
        for name, values in corruptions(trace.reference).items():
            corrupted = replace(trace, columns={**trace.columns, "ambient_degC": values})
            with np.errstate(invalid="ignore"):
                if name != "missing":
                    assert not np.array_equal(peeking.estimate(corrupted), peeking.estimate(trace)), name
