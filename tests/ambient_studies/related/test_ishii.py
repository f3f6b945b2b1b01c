"""Ishii and Nakashima's two models: a world made by transfer functions comes back."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from ambient_model.faults import Refused
from ambient_studies.related import ishii
from ambient_trainer.data.trace import Trace

Made = Callable[..., Trace]

GAIN = np.array([1.0, -0.1, -0.2, -0.3, -0.15])
ZERO_S = np.array([200.0, 60.0, 10.0, 100.0, 150.0])
POLE_S = np.array([40.0, 120.0, 50.0, 400.0, 30.0])


def world(trace: Trace, separation: np.ndarray, noise: float = 0.0) -> Trace:
    """The ambient behind K (1 + tau1 s)/(1 + tau2 s) of every source, by a library's simulation."""
    ambient = np.full(len(trace.time_s), -0.5)
    for source, K, tau1, tau2 in zip(separation @ rows(trace), GAIN, ZERO_S, POLE_S):
        _, response, _ = lsim(([K * tau1, K], [tau2, 1.0]), source - source[0], trace.time_s)
        ambient += K * source[0] + response
    ambient += noise * np.random.default_rng(4).standard_normal(len(ambient))
    return replace(trace, columns={**trace.columns, "ambient_degC": ambient})


def rows(trace: Trace) -> np.ndarray:
    return np.vstack([trace.columns[name] for name in ishii.SENSORS])


def test_a_world_of_transfer_functions_comes_back(made: Made) -> None:
    trace = made(5000, seed=1)
    separation = ishii.separated(trace)

    found = ishii.fit(world(trace, separation, noise=0.1))

    assert np.array_equal(found.separation, separation)
    assert found.time_constant_s == pytest.approx(POLE_S, rel=0.1)
    assert found.gain == pytest.approx(GAIN, abs=0.01)
    assert found.direct * found.time_constant_s / found.gain == pytest.approx(ZERO_S, rel=0.1, abs=2.0)
    assert found.offset_degC == pytest.approx(-0.5, abs=0.1)
    unseen = world(made(3000, seed=2), separation)
    error = found.estimate(unseen) - unseen.reference
    assert np.sqrt(np.mean(error**2)) < 0.03


def test_the_sources_are_what_no_stronger_source_explains(made: Made) -> None:
    trace = made(3000, seed=1)
    usb, *others = rows(trace)

    reference, *sources = ishii.separated(trace) @ rows(trace)

    assert np.array_equal(reference, usb)
    stronger: list[np.ndarray] = []
    for sensor, source in zip(others, sources):
        expected = sensor - usb
        if stronger:
            shares = np.linalg.lstsq(np.array(stronger).T, expected, rcond=None)[0]
            expected = expected - shares @ np.array(stronger)
        assert source == pytest.approx(expected, abs=1e-8)
        stronger.append(source)


def test_a_sensor_that_copies_another_is_refused(made: Made) -> None:
    trace = made(500, seed=1)
    copied = replace(trace, columns={**trace.columns, "flash_degC": trace.columns["usb_degC"]})

    with pytest.raises(Refused) as refused:
        ishii.fit(copied)

    assert str(refused.value) == (
        "made 1: the rises of soc_degC, flash_degC, battery_degC, display_degC over usb_degC are not independent; "
        "log a run in which each moves by itself"
    )
