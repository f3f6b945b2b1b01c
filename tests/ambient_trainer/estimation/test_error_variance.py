"""The error variance model finds a known variance, its levels cover; blocks hold every sample out once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.model import Term
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation import error_variance
from ambient_trainer.estimation.error_variance import Moment, fit_error_variance, regressors_degC2, sigma_degC
from ambient_trainer.estimation.validation import cut_in_blocks
from refusals import refused

PERIOD_S = 1.0


def run(seed, samples=30_000, constant=0.04, weight=0.5, lag_s=10.0):
    """An estimate that rests and moves by turns, and errors whose variance grows with the movement."""
    random = np.random.default_rng(seed)
    moving = np.repeat(random.random(samples // 500) < 0.3, 500)
    estimate = 20 + np.cumsum(random.normal(0, 0.3, samples) * moving)
    variance = constant + weight * regressors_degC2([Term("movement", lag_s, 1.0)], estimate, 0 * estimate, PERIOD_S)[1]
    return Moment(estimate, estimate + random.standard_normal(samples) * np.sqrt(variance)), variance


def test_a_known_variance_is_found_and_wide_where_the_estimate_moves():
    moment, variance = run(1)
    model = fit_error_variance([moment], PERIOD_S)
    # levels are of the errors: 90 % of normal ones lie within 1.645
    sigma = sigma_degC(model, moment.estimate_degC, 0 * variance, PERIOD_S) * model.quantiles[90][1] / 1.645
    assert np.median(np.abs(np.log(sigma / np.sqrt(variance)))) < 0.05
    half = error_variance.half_widths(model, [moment], PERIOD_S)
    assert half["10"] == pytest.approx(0.2 * 1.645, rel=0.1)
    assert half["90"] > 2 * half["10"]


def test_the_levels_cover_another_run():
    model = fit_error_variance([run(1)[0]], PERIOD_S)
    moment, _ = run(2)
    off = np.abs(moment.reference_degC - moment.estimate_degC)
    sigma = sigma_degC(model, moment.estimate_degC, 0 * off, PERIOD_S)
    quiet = sigma < np.quantile(sigma, 0.5)
    for level, (low, high) in model.quantiles.items():
        assert low == -high
        for part in (quiet, ~quiet):
            assert np.mean(off[part] <= high * sigma[part]) == pytest.approx(level / 100, abs=0.02)


def test_what_counts_twice_is_like_having_it_twice():
    moment, _ = run(4, 3000)
    part = Moment(moment.estimate_degC[:1000], moment.reference_degC[:1000])
    twice = fit_error_variance([moment, part, part], PERIOD_S)
    weighted = fit_error_variance([moment, part._replace(weight=2.0)], PERIOD_S)
    assert weighted.constant_degC2 == pytest.approx(twice.constant_degC2, rel=1e-4)
    assert weighted.quantiles[90][1] == pytest.approx(twice.quantiles[90][1], rel=1e-3)


def test_heat_that_drives_the_estimators_apart_to_one_side_has_an_interval_of_its_own():
    """At times the secondary estimate lies 0.5 degC above or below, and errors are four times as large on one side."""

    def drawn(seed):
        random = np.random.default_rng(seed)
        apart = np.repeat(random.choice([0.0, 0.5, -0.5], 60, p=[0.8, 0.1, 0.1]), 500)
        off = np.where(apart > 0, 0.4, np.where(apart < 0, 1.6, 0.2)) * random.standard_normal(len(apart))
        return Moment(np.full(len(apart), 20.0), 20 + off, apart)

    terms = [Term(of, 30.0, 1.0) for of in ("guard_above", "guard_below")]
    model, (estimate, reference, apart, _) = fit_error_variance([drawn(1)], PERIOD_S, terms), drawn(2)
    reach = model.quantiles[90][1] * sigma_degC(model, estimate, apart, PERIOD_S)
    for side in (apart > 0, apart < 0):
        assert 0.85 < np.mean(np.abs(reference - estimate)[side] <= reach[side]) < 0.97
    below = fit_error_variance([Moment(estimate, reference, np.minimum(apart, 0.0))], PERIOD_S, terms).terms
    assert [each.weight for each in below] == [below[1].weight] * 2, "the side that is unseen is as unsure"


def segment(count, period_s=1.0):
    return Segment(period_s, np.zeros((1, count)), np.zeros((1, count)))


@given(st.lists(st.integers(20, 400), min_size=1, max_size=4), st.integers(2, 12), st.floats(0, 50))
def test_every_sample_is_held_out_once(lengths, count, gap_s):
    laid = [segment(each, 2.0) for each in lengths]
    if len(lengths) == 1 or count > 1:
        found = cut_in_blocks(laid, count, gap_s, "t.csv")
        for index, length in enumerate(lengths):
            own = [each for each in found if each.segment == index]
            held = np.concatenate([np.arange(each.start, each.stop) for each in own])
            np.testing.assert_array_equal(held, np.arange(length))
            for each in own:
                assert each.first == max(0, each.start - round(gap_s / 2.0))
                assert each.last == min(length, each.stop + round(gap_s / 2.0))


def test_the_gap_defaults_to_a_tenth_of_a_block_and_a_reference_in_one_block_only_is_refused():
    _, second, _ = cut_in_blocks([segment(300)], 3, None, "t.csv")
    assert (second.first, second.start, second.stop, second.last) == (90, 100, 200, 210)
    laid = segment(300)
    laid.outputs[:, 100:] = np.nan
    assert "the reference fills less than two blocks" in str(refused(cut_in_blocks, [laid], 3, None, "t.csv"))
