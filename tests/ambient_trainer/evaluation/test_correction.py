"""A correction against errors that are known by construction, in the file and through the daemon's own recursion."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.codec import decode, encode, load_model
from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model, ReadingModel, Secondary, SensorLimits
from ambient_trainer.data.trace import Trace, save_trace
from ambient_trainer.evaluation.correction import corrected, correction
from ambient_trainer.evaluation.evaluate import evaluate_trace

PERIOD_S = 5.0
INPUTS = (Input("usb", "degC", "usb", -45.0, 130.0), Input("display", "degC", "display", -45.0, 130.0))


def weighted(inputs: tuple[Input, ...], weights: tuple[float, ...], offset: float) -> Estimator:
    """No memory: the weighted mean of the sensors."""
    discrete = tuple(Discrete(period_s, (), (), ((),), (weights,)) for period_s in (1.0, PERIOD_S))
    return Estimator(inputs, (), discrete, offset, (), {50: (-0.1, 0.1), 90: (-0.2, 0.2), 98: (-0.3, 0.3)})


def mean_model(guarded: bool = True) -> Model:
    """Half usb, half display; without usb the display alone; the guard believes usb more."""
    main = weighted(INPUTS, (0.5, 0.5), 1.0)
    model = Model(
        name="mean",
        created="2024-01-01T00:00:00Z",
        output="ambient",
        main=main,
        fallbacks={"usb": weighted(INPUTS[1:], (1.0,), -2.0)},
        provenance={"circuit": "mean"},
        conformance=conformance_of(main, ((20.0, 21.0), (30.0, 28.0))),
        secondary=Secondary(weighted(INPUTS, (0.75, 0.25), 0.5), 1e3) if guarded else None,
    )
    return decode(encode(model).encode(), "mean")


def known_trace(ambient_degC: float = 21.0, samples: int = 400, seed: int = 0) -> Trace:
    """The ambient is constant; usb reads 4 more, display 2 more, both with noise."""
    random = np.random.default_rng(seed)
    columns = {
        "usb_degC": ambient_degC + 4 + 0.1 * random.normal(size=samples),
        "display_degC": ambient_degC + 2 + 0.1 * random.normal(size=samples),
        "ambient_degC": np.full(samples, ambient_degC),
    }
    return Trace("known.csv", np.arange(samples) * 1.0, columns)


def test_the_corrected_file_is_right_on_average_and_otherwise_the_same():
    model, trace = mean_model(), known_trace()
    found = correction(model, trace)
    assert list(found.offsets_degC) == ["main", "without usb", "guard"]
    # white noise of 0.1 in each sensor
    assert found.standard_error_degC == pytest.approx(0.1 * np.sqrt(0.5) / np.sqrt(400), rel=0.5)
    result = corrected(model, found, {"trace": "known.csv", "sha256": "0" * 64, "from_s": None, "to_s": None})
    assert evaluate_trace(result, trace).metrics.mbe_degC == pytest.approx(0.0, abs=1e-9)
    before, after = evaluate_trace(model, known_trace(seed=5)), evaluate_trace(result, known_trace(seed=5))
    assert before.metrics.mbe_degC == pytest.approx(-4.0, abs=0.02)
    assert abs(after.metrics.mbe_degC) < 0.02
    assert after.metrics.sigma_degC == pytest.approx(before.metrics.sigma_degC, rel=1e-9)
    assert result.main._replace(offset=model.main.offset) == model.main
    assert result.secondary.threshold_degC == model.secondary.threshold_degC
    for each in (result.fallbacks["usb"], result.secondary.estimator):
        alone = result._replace(main=each, fallbacks={}, secondary=None)
        assert evaluate_trace(alone, trace).metrics.mbe_degC == pytest.approx(0.0, abs=1e-9)


def test_only_what_is_known_counts_but_the_estimate_runs_from_the_start():
    """A lag's error after it has settled, not that of its start."""
    trace = known_trace(samples=3000)
    jump = np.where(trace.time_s < 1000, 15.0, 0.0)
    columns = {name: values + jump for name, values in trace.columns.items() if name != "ambient_degC"}
    trace = replace(trace, time_s=trace.time_s * 5, columns={**columns, "ambient_degC": trace.reference})
    lag = Discrete(PERIOD_S, ((0.999,),), ((0.0005, 0.0005),), ((1.0,),), ((0.0, 0.0),))
    main = Estimator(INPUTS, ("lag",), (lag,), 0.0, ((0.5, 0.5),), weighted(INPUTS, (0.5, 0.5), 0.0).interval)
    model = mean_model()._replace(main=main, fallbacks={}, secondary=None)
    found = correction(model, trace, 10_000.0, 14_000.0)
    assert found.samples == 800
    whole = evaluate_trace(model, trace).error_degC
    assert abs(whole[2000:2800].mean() - whole.mean()) > 0.5
    assert found.offsets_degC["main"] == pytest.approx(whole[2000:2800].mean(), abs=1e-9)


def test_what_readings_are_expected_to_be_does_not_enter():
    """It is of all sensors, and a fallback has fewer; published estimates are bounded, the recursion's are not."""
    limits = SensorLimits(0.0, 5.0, 5.0, 5.0, 600.0, 60.0, 0.5)
    mean, precision = (25.0, 23.0) * 2, tuple(map(tuple, np.eye(4).tolist()))
    readings = ReadingModel((60.0,), mean, precision, (limits, limits), 1.0, 60.0, (-50.0, 22.0), 1.0)
    model = mean_model()
    assert correction(model._replace(readings=readings), known_trace()) == correction(model, known_trace())


def test_correct_writes_a_model_that_is_right_there(trainer, figures, saved, tmp_path):
    trace, output = tmp_path / "known.csv", tmp_path / "corrected.json"
    save_trace(str(trace), known_trace(samples=600))
    found, out = figures("correct", saved(mean_model()), trace, "-o", output, "--from", 300)
    assert found["samples"] == 300
    # usb and display are 3 degC off on average, and the offset was 1
    columns = known_trace(samples=600).cut(300, None).columns
    expected = 21 - (columns["usb_degC"] + columns["display_degC"]).mean() / 2 - 1
    assert all(said in out for said in (f"{expected:+.3f} degC", "300 samples", f"Model: {output}"))
    model = load_model(str(output))
    assert model.main.offset == pytest.approx(1.0 - 4.0, abs=0.02)
    [said] = model.provenance["corrections"]
    assert (said["trace"], said["from_s"], said["to_s"], said["samples"]) == ("known.csv", 300.0, None, 300)
    assert len(said["sha256"]) == 64
    assert trainer("correct", output, trace, "-o", tmp_path / "again.json", "--from", 300)[0] == 0
