"""The tests of a residual: right formulas, few false alarms whatever its memory, and an eye for what was planted."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from ambient_trainer.diagnosis.residual_tests import correlation_s, residual_tests
from ambient_trainer.diagnosis.residual_tests.prewhitening import Largest, correlated, shifted, whitening
from ambient_trainer.diagnosis.residual_tests.whiteness import cumulated_periodogram, ljung_box

WHITENESS = {"whiteness", "periodogram", "memory"}
SENSORS = ("soc", "flash")


def remembering(weight, shape, random):
    """Unit-variance first-order autoregressions."""
    noise = random.standard_normal((*shape[:-1], 2 * shape[-1]))
    return lfilter([1.0], [1.0, -weight], noise, axis=-1)[..., shape[-1] :] * np.sqrt(1 - weight**2)


def slow(course, steps):
    return lfilter([1 / steps], [1, 1 / steps - 1], course)


class World:
    """Two nodes, four signals, an ambient, and residuals with some memory and nothing else."""

    def __init__(self, seed, samples=300, weight=0.0, white=0.0):
        random = np.random.default_rng(seed)
        self.time_s = 10.0 * np.arange(samples)
        self.ambient = 20 + 6 * np.sin(self.time_s / 400) + 2 * remembering(0.99, (samples,), random)
        self.signals = {
            "cpu_load_frac": (remembering(0.97, (samples,), random) > 0) * 1.0,
            "camera_on": ((self.time_s > 0.4 * self.time_s[-1]) & (self.time_s < 0.55 * self.time_s[-1])) * 1.0,
            "radio_power_W": np.abs(remembering(0.9, (samples,), random)),
            "wind_m_s": np.exp(remembering(0.995, (samples,), random)),
        }
        warm = slow(self.ambient - 20, 60) + 20 + 9 * slow(self.signals["cpu_load_frac"], 60)
        self.simulated = np.stack([warm + 4, warm])
        self.residual = 0.1 * remembering(weight, (2, samples), random)
        self.residual += white * random.standard_normal((2, samples))

    def tests(self):
        heat = np.gradient(self.residual, 10.0, axis=1) + self.residual / 500
        measured = self.simulated + self.residual
        return residual_tests(self.time_s, self.residual, heat, SENSORS, self.signals, self.ambient, measured)

    def significant(self):
        return {(each.name, each.subject): each for each in self.tests() if each.significant}


def test_residuals_that_only_remember_raise_few_alarms():
    memories = [(0.0, 0.0), (0.95, 0.0), (0.99, 0.0), (0.99, 0.1)]
    worlds = [World(seed, 400, *memories[seed % 4]) for seed in range(24)]
    found = [{name for name, _ in each.significant()} for each in worlds]
    # with 5 % each, more than 4 of 24 come once in 170; 6 of them are white, and more than 2 of 6 come once in 400
    assert sum(bool(names - WHITENESS) for names in found) <= 4
    assert sum(bool(names & WHITENESS) for names in found[::4]) <= 2


def test_a_record_no_longer_than_its_memory_raises_few_alarms():
    """Half white noise, half with a memory of 100 samples: filtered by least squares, 15 of these had one."""
    found = [World(seed, 100, 0.99, 0.1).significant() for seed in range(30)]
    assert sum(any(name not in WHITENESS for name, _ in each) for each in found) <= 4


@pytest.mark.parametrize("weight", [0.3, 0.95, 0.99])
def test_residuals_that_remember_are_not(weight):
    found = World(1, samples=600, weight=weight).significant()
    assert {("whiteness", "soc"), ("periodogram", "soc")} <= set(found)
    assert (("memory", "soc") in found) == (weight > 0.5)


@pytest.mark.parametrize(
    ("planted", "name", "subject"),
    [
        ("camera", "cross-correlation", "flash, camera_on"),
        ("difference", "ambient difference", "flash"),
        ("bent", "ambient difference, curved", "flash"),
        ("rate", "ambient rate", "flash"),
        ("drift", "drift", "flash"),
        ("step", "change", "flash"),
        ("heat", "change of heat", "flash"),
    ],
)
def test_what_was_planted_is_found(planted, name, subject):
    world = World(7, samples=600, weight=0.95)
    difference = world.simulated[1] - world.ambient
    centred = difference - difference.mean()
    world.residual[1] += {
        "camera": lambda: 3 * slow(world.signals["camera_on"], 30),
        "difference": lambda: slow(centred, 30),
        "bent": lambda: 0.4 * slow(centred**2, 30),
        "rate": lambda: 10 * np.gradient(world.ambient),
        "drift": lambda: 3 * world.time_s / world.time_s[-1],
        "step": lambda: 2.0 * (world.time_s > 3600),
        "heat": lambda: 3 * slow(world.time_s > 3600, 30),
    }[planted]()
    found = world.significant()
    assert (name, subject) in found
    assert not {each for each in found if each[1].startswith("soc") and each[0] not in WHITENESS}
    if planted == "camera":
        said = "flash: the residual follows camera_on with a delay of about 5.0 min, by "
        assert found[name, subject].sentence.startswith(said)
    if planted in ("camera", "drift"):
        size = float(found[name, subject].sentence.split(" by ")[1].split()[0])
        assert size == pytest.approx(3.0, rel=0.15)
    if planted in ("step", "heat"):
        hours, minutes, seconds = map(int, found[name, subject].sentence.rstrip(".").split()[-1].split(":"))
        assert 3600 * hours + 60 * minutes + seconds == pytest.approx(3600, abs=90)


def test_a_window_of_heat_turns_twice():
    world = World(3, samples=600)
    world.residual[0] += 3 * ((world.time_s > 2000) & (world.time_s < 3500))
    said = world.significant()["change", "soc"].sentence
    assert said.startswith("soc: the residual rises by ")
    assert said.endswith(" and comes back, at about 0:33:20 and 0:58:10.")


def test_missing_values_cost_nothing_but_themselves():
    world = World(5, samples=600)
    world.residual[1] += 3 * slow(world.signals["camera_on"], 30)
    world.residual[0, 100:140] = np.nan
    world.residual[1, ::97] = np.nan
    world.signals["camera_on"][50:60] = np.nan
    world.signals["radio_power_W"][:] = np.nan
    world.ambient[300:310] = np.nan
    tests = world.tests()
    assert ("cross-correlation", "flash, camera_on") in {
        (each.name, each.subject) for each in tests if each.significant
    }
    assert not [each for each in tests if "radio_power_W" in each.subject]
    assert all(np.isfinite([each.statistic, each.threshold]).all() for each in tests)


def test_what_cannot_be_tested_is_left_out_and_the_same_residual_has_the_same_tests():
    world = World(2)
    world.residual[0] = np.nan
    world.ambient[:] = 21.0
    world.signals["camera_on"][:] = 1.0
    subjects = {each.subject for each in world.tests()}
    assert subjects == {"flash", *(f"flash, {name}" for name in world.signals if name != "camera_on")}
    assert not [each for each in world.tests() if each.name.startswith("ambient rate")]
    short = World(2, samples=30)
    assert short.tests() == ()
    world.residual[:] = 0.0
    assert world.tests() == ()
    assert World(4).tests() == World(4).tests()


def test_ljung_and_box_by_hand():
    series = remembering(0.2, (150,), np.random.default_rng(1))
    said = ljung_box(series, "soc", 0.01)
    centred = series - series.mean()
    q = 0.0
    for lag in range(1, 21):
        rho = sum(centred[k] * centred[k - lag] for k in range(lag, 150)) / sum(centred**2)
        q += rho**2 / (150 - lag)
    assert said.statistic == pytest.approx(150 * 152 * q)
    assert stats.chi2.cdf(said.threshold, 20) == pytest.approx(0.99)


@pytest.mark.parametrize("samples", [200, 201])
def test_the_periodogram_is_kolmogorovs(samples):
    series = remembering(0.3, (samples,), np.random.default_rng(3))
    said = cumulated_periodogram(series, "soc", 1.0, 0.05)
    centred = series - series.mean()
    k = np.arange(samples)
    power = [
        abs(np.sum(centred * np.exp(-2j * np.pi * k * j / samples))) ** 2 for j in range(1, (samples - 1) // 2 + 1)
    ]
    oracle = stats.ks_1samp(np.cumsum(power)[:-1] / np.sum(power), stats.uniform.cdf)
    assert said.statistic == pytest.approx(oracle.statistic)
    assert said.significant == (oracle.pvalue < 0.05)
    assert "periods longer than" in said.sentence


def test_memory_is_the_time_to_one_over_e():
    series = remembering(np.exp(-1 / 20), (200_000,), np.random.default_rng(4))
    assert correlation_s(5.0 * np.arange(1200), series[:1200]) == pytest.approx(100.0, rel=0.2)


def test_a_long_residual_is_tested_by_means():
    time_s = np.arange(5000.0)
    values = np.sin(time_s / 300)
    assert correlation_s(time_s, values) == pytest.approx(correlation_s(time_s[::5], values[::5]), rel=0.01)


def test_what_is_followed_is_a_regression_of_what_is_whitened():
    random = np.random.default_rng(5)
    series = remembering(0.97, (1200,), random) + 0.5 * random.standard_normal(1200)
    course, whiten = remembering(0.5, (1200,), random), whitening(series)
    innovations = np.convolve(series, whiten, "valid")
    assert not ljung_box(innovations, "", 0.01).significant
    largest, _, _ = correlated(series, whiten, course[None])
    oracle = stats.linregress(np.convolve(course, whiten, "valid"), innovations)
    assert stats.t.sf(largest.t, largest.free) == pytest.approx(oracle.pvalue / 2, rel=0.05)
    assert Largest(0.0, 4, 10**6).threshold(0.05) == pytest.approx(stats.norm.isf(0.05 / 8), rel=1e-4)


def test_a_shift_is_the_best_of_all_stretches_by_least_squares():
    series = remembering(0.0, (132,), np.random.default_rng(2)) + 2.0 * (np.arange(132) >= 80)
    largest, turns = shifted(series)
    beside = np.column_stack([series[32 - lag : 132 - lag] for lag in range(1, 99 - largest.free)] + [np.ones(100)])
    columns = (np.column_stack([beside, np.arange(100) >= start]) for start in range(4, 97))
    without, *left = (np.linalg.lstsq(each, series[32:])[1][0] for each in (beside, *columns))
    assert turns == [31 + 4 + int(np.argmin(left))]
    assert largest.t**2 == pytest.approx((without / min(left) - 1) * largest.free)
