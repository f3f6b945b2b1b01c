"""The benchmark from end to end with a small circuit, in this process and in others."""

from dataclasses import replace

import pytest

from ambient_studies.discovery.cases import simulated
from ambient_studies.discovery.runner import run
from ambient_trainer.diagnosis.result import Cause

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def done(bench, cases):
    return list(run(bench, cases, 2))


def test_workers_find_what_is_hidden(done, cases):
    assert [each.case for each in done] == list(cases)
    nothing, bias = (each.outcome for each in done)
    assert nothing.true == ()
    assert nothing.correct == (nothing.found == ())
    assert bias.true == (Cause("sensor_bias", "display"),)
    assert bias.correct
    assert done[1].outcome.onset_right
    assert done[1].outcome.magnitude_right
    assert bias.gain_ci[0] > 0.0
    assert "sensor_bias at display" in done[1].sentences[0]


def test_one_process_says_the_same_and_never_sees_the_truth(bench, cases, done, monkeypatch):
    lies = [replace(each, truths=(), clean=None) for each in simulated(cases[1:])]
    monkeypatch.setattr("ambient_studies.discovery.runner.simulated", lambda _: lies)
    (alone,) = run(bench, cases[1:], 1)
    assert (alone.sentences, alone.rivals) == (done[1].sentences, done[1].rivals)
    assert not alone.outcome.correct


def test_a_bias_is_as_large_as_it_is(bench, done):
    sensors = [output.name for output in bench.known.model.circuit.outputs]
    deviation = bench.known.noise_degC[sensors.index("display")]
    # it comes within a minute and a half
    assert done[1].outcome.size_in_noise == pytest.approx(4.0 / deviation, rel=0.03)
    assert done[0].outcome.size_in_noise == 0.0
