"""The benchmark from end to end with a small circuit, in this process and in others."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_studies.discovery.cases import Case, simulated
from ambient_studies.discovery.runner import run, size_in_noise
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.simulator.hidden import Hidden

pytestmark = pytest.mark.slow

BIAS = Cause("sensor_bias", "display")


@pytest.fixture(scope="module")
def done(bench, cases):
    return list(run(bench, cases, 2))


def test_workers_find_what_is_hidden(done, cases):
    assert [each.case for each in done] == list(cases)
    nothing, bias = (each.scored.outcome for each in done)
    assert nothing.true == ()
    assert nothing.correct == (nothing.found == ())
    assert bias.true == (BIAS,)
    assert bias.correct
    assert done[1].scored.onset_right
    assert done[1].scored.magnitude_right
    assert bias.gain_ci is not None
    assert bias.gain_ci[0] > 0.0
    assert "sensor_bias at display" in done[1].sentences[0]


def test_one_process_says_the_same_and_never_sees_the_truth(bench, cases, done, monkeypatch):
    lies = [replace(each, truths=(), clean=None) for each in simulated(cases[1:])]
    monkeypatch.setattr("ambient_studies.discovery.runner.simulated", lambda _: lies)
    (alone,) = run(bench, cases[1:], 1)
    assert (alone.sentences, alone.rivals) == (done[1].sentences, done[1].rivals)
    assert not alone.scored.outcome.correct


def test_a_bias_is_as_large_as_it_is(bench, done):
    sensors = [output.name for output in bench.known.model.circuit.outputs]
    deviation = bench.known.noise_degC[sensors.index("display")]
    # it comes within a minute and a half
    assert done[1].scored.outcome.size_in_noise == pytest.approx(4.0 / deviation, rel=0.03)
    assert done[0].scored.outcome.size_in_noise == 0.0


def test_a_clock_is_as_large_as_the_circuit_feels_it(bench):
    def size(seconds):
        (shifted,) = simulated([Case(0, 3, (Hidden("clock_offset", None, None, 0.0, None, seconds),), (), "3")])
        return size_in_noise(bench, shifted)

    # twice as late is twice as wrong while that is little beside the circuit's own minutes
    assert size(60.0) > 0.5
    assert size(60.0) == pytest.approx(2.0 * size(30.0), rel=0.1)


def test_of_two_the_smaller_counts(bench):
    small = Hidden("sensor_bias", "usb", None, 1000.0, None, 0.5)
    large = Hidden("sensor_drift", "display", None, 1000.0, None, 20.0)
    both, one = simulated([Case(0, 3, (large, small), (), "3"), Case(1, 3, (small,), (), "3")])
    assert size_in_noise(bench, both) == pytest.approx(size_in_noise(bench, one))
    assert np.isfinite(size_in_noise(bench, both))
