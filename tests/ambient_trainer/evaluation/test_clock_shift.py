"""The shift between two clocks, against curves in closed form that were shifted by a known time."""

import numpy as np
import pytest

from ambient_trainer.data.trace import Trace
from ambient_trainer.evaluation.clock_shift import clock_shift

HOUR_S = 3600.0


def day_degC(time_s, lag_s=0.0):
    """A day that never repeats: tones whose periods are not in ratio; a lag, settled, makes each weaker and later."""
    tones = ((4, 5100.0, 0.0), (2, 1733.0, 0.0), (1, 611.0, 1.0))
    return 20 + sum(
        size / np.hypot(1, lag_s / period) * np.sin(time_s / period + phase - np.arctan(lag_s / period))
        for size, period, phase in tones
    )


def logged(name, curve, period_s, shift_s=0.0, noise_degC=0.05, seed=1, hours=12.0):
    """A logger's trace, whose clock is ``shift_s`` behind."""
    time_s = np.arange(0.0, hours * HOUR_S, period_s)
    values = curve(time_s + shift_s) + noise_degC * np.random.default_rng(seed).standard_normal(len(time_s))
    return Trace(f"{name}.csv", time_s, {f"{name}_degC": np.round(values, 1)})


def holds(shift, true_s, widest_s):
    low, high = shift.ci95_s
    return shift.problem is None and low < true_s < high and high - low < widest_s


@pytest.mark.parametrize("periods_s", [(1.0, 10.0), (60.0, 10.0), (30.0, 30.0)])
@pytest.mark.parametrize("true_s", [-5000.0, 0.0, 17.3])
def test_a_column_that_both_have(periods_s, true_s):
    one = logged("ambient", day_degC, periods_s[0])
    other = logged("ambient", lambda time_s: 0.7 + 0.98 * day_degC(time_s), periods_s[1], true_s, seed=2)
    shift = clock_shift(one, other)
    assert holds(shift, true_s, 1.2 * max(periods_s))
    assert shift.significant == (true_s != 0.0)
    assert shift.columns == ("ambient_degC", "ambient_degC")


@pytest.mark.parametrize("driven_first", [True, False])
def test_a_column_that_drives_one_of_the_other(driven_first):
    lag_s, true_s = 900.0, 300.0
    air = logged("air", day_degC, 20.0, 0.0 if not driven_first else true_s)
    board = logged("board", lambda time_s: day_degC(time_s, lag_s), 20.0, true_s if not driven_first else 0.0)
    shift = clock_shift(board, air) if driven_first else clock_shift(air, board)
    assert holds(shift, true_s, 200.0)
    assert shift.lags_s[0] == pytest.approx(lag_s, rel=0.1)


def test_a_curve_that_repeats_and_columns_that_share_nothing_leave_it_open():
    def wave(time_s):
        return 20 + 5 * np.sin(2 * np.pi * time_s / 2400.0)

    one, other = logged("ambient", wave, 10.0), logged("ambient", wave, 10.0, 50.0, seed=2)
    assert clock_shift(one, other).problem is not None
    assert holds(clock_shift(one, other, within_s=1000.0), 50.0, 10.0)

    def walk(seed):
        steps = np.random.default_rng(seed).standard_normal(int(12 * HOUR_S / 10.0) + 1)
        return lambda time_s: 20 + 0.1 * np.interp(time_s, 10.0 * np.arange(len(steps)), np.cumsum(steps))

    one, other = logged("air", walk(5), 10.0), logged("board", walk(6), 10.0)
    shift = clock_shift(one, other)
    assert shift.problem is not None
    assert not shift.significant


@pytest.mark.parametrize(("samples", "curve"), [(500, np.zeros_like), (6, day_degC)])
def test_columns_that_never_change_or_are_short_have_no_shift(samples, curve):
    other = Trace("other.csv", 10.0 * np.arange(samples), {"ambient_degC": curve(10.0 * np.arange(samples))})
    assert clock_shift(logged("ambient", day_degC, 10.0), other) is None


def test_gaps_on_both_sides():
    one, other = logged("ambient", day_degC, 10.0), logged("ambient", day_degC, 10.0, 17.3, seed=2)
    first, second = (one.time_s < 9000) | (one.time_s > 14000), (other.time_s < 20000) | (other.time_s > 31000)
    parts = [
        Trace(each.path, each.time_s[kept], {name: row[kept] for name, row in each.columns.items()})
        for each, kept in ((one, first), (other, second))
    ]
    assert holds(clock_shift(*parts), 17.3, 10.0)
