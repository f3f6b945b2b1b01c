"""The score of every window at once against a regression of its own for each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.diagnosis.candidate import Candidate, Span
from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.model import view
from ambient_trainer.diagnosis.screening import Regression, refined, scored
from ambient_trainer.diagnosis.setting import setting_of
from ambient_trainer.diagnosis.terms import beginning, ending
from ambient_trainer.diagnosis.view import View
from ambient_trainer.estimation.noise import ORDER, Noise

N = 260
TIME_S = 10.0 * np.arange(N)
START = np.array([30.0, 26.0, 22.0])
ONSETS = [float(each) for each in range(305, 2505, 200)]


def _heat(t: float, x: np.ndarray, air: float) -> np.ndarray:
    return np.array([0.0, 0.0, 0.02 * (705.0 <= t < 1705.0)])


def _seen(chain, seed: int, heat=_heat) -> View:
    inputs = chain.inputs(N, seed)
    nodes = chain.integrated(inputs, START, heat)
    read = nodes + 0.05 * np.random.default_rng(seed).standard_normal(nodes.shape)
    read[1, 100:110] = np.nan
    return view(chain.model(), chain.record(inputs, read))


@pytest.fixture(scope="module")
def seen(chain) -> View:
    return _seen(chain, 1)


@pytest.fixture(scope="module")
def candidates(chain, seen) -> dict[str, Candidate]:
    return {str(each.cause): each for each in reversed(list(all_candidates(setting_of(chain.model(), [seen]))))}


@pytest.fixture(scope="module")
def noise(seen) -> Noise:
    return Noise.of([seen.residual_degC])


def _rows(noise: Noise, view: View, rows: np.ndarray) -> np.ndarray:
    """Whitened, and only where everything was read."""
    known = ~np.isnan(noise.white(view.residual_degC))
    return noise.white(rows)[..., known]


def _best_by_hand(
    noise: Noise,
    views: list[View],
    candidate: Candidate,
    extra: list[list[np.ndarray]],
    prior_rows: tuple[np.ndarray, np.ndarray] | None = None,
):
    """Over all windows: (explained, onset, end, values), from least squares with everything side by side.

    What was ``prior_rows`` of what is ``extra`` stands beneath, as rows that the candidate has no part in.
    """
    target = np.concatenate(
        [noise.white(each.residual_degC)[~np.isnan(noise.white(each.residual_degC))] for each in views]
    )
    width = [int((~np.isnan(noise.white(each.residual_degC))).sum()) for each in views]
    fixed = []
    for index, each in enumerate(views):
        for start in each.starts:
            blocks = [np.zeros(count) for count in width]
            blocks[index] = _rows(noise, each, start)
            fixed.append(np.concatenate(blocks))
    for number in range(len(extra[0]) if extra else 0):
        fixed.append(np.concatenate([_rows(noise, each, own[number]) for each, own in zip(views, extra)]))
    base, rows = np.array(fixed).T, len(target)
    if prior_rows is not None:
        known, off = prior_rows
        held = np.zeros((len(off), base.shape[1]))
        held[:, base.shape[1] - len(known) :] = known.T
        base, target = np.concatenate([base, held]), np.concatenate([target, off])
    alone = target - base @ np.linalg.lstsq(base, target, rcond=None)[0]
    best = None
    edges = [None, *ONSETS]
    for start in edges:
        for end in [*ONSETS, None]:
            if end is not None and (start if start is not None else -np.inf) >= end:
                continue
            if end is not None and start is not None and end - start < 300:
                continue
            columns = []
            for number in range(len(candidate.fixed)):
                parts = []
                for each in views:
                    term = candidate.terms(each)[number]
                    added = beginning(each, term, [start])[0]
                    added = added if end is None else added - ending(each, term, [end])[0]
                    parts.append(_rows(noise, each, added))
                columns.append(np.concatenate([*parts, np.zeros(len(target) - rows)]))
            both = np.column_stack([base, *columns])
            solution = np.linalg.lstsq(both, target, rcond=None)[0]
            left = target - both @ solution
            explained = float(alone @ alone - left @ left)
            values = solution[base.shape[1] :]
            cost = np.log(rows) * (len(columns) + 2.0 * ((start is not None) + (end is not None)))
            score = -rows * np.log1p(-explained / (alone @ alone)) - cost
            if candidate.plausible(values) and (best is None or score > best[0]):
                best = (score, explained, start, end, values)
    return best


@pytest.mark.parametrize(
    "cause", ["heat_source at shell", "contact at shell", "sensor_bias at board", "path at chip-shell"]
)
@pytest.mark.parametrize("nuisance", ["none", "free", "prior", "sure prior"])
def test_every_window_by_hand(chain, seen, noise, candidates, cause: str, nuisance: str) -> None:
    """Nuisance parameters with a prior are held by as many rows as that takes: a ridge about where they were."""
    extra = [[np.cumsum(np.ones((3, N)), axis=1) / N, np.sin(TIME_S / 300) * np.ones((3, 1))]]
    extra = [] if nuisance == "none" else extra
    prior_rows = None
    if nuisance.endswith("prior"):
        sure = 1e3 if nuisance == "sure prior" else 8.0
        known = sure * np.array([[1.0, 0.3, 0.0], [0.0, 2.0, 0.5]])
        prior_rows = known, known.T @ np.array([0.2, -0.1])
    frame = Regression.of([seen], noise, extra, prior_rows)
    found = scored(frame, candidates[cause], ONSETS)
    wanted = _best_by_hand(noise, [seen], candidates[cause], extra, prior_rows)
    assert (found is None) == (wanted is None)
    if found is None:
        return
    score, explained, onset_s, end_s, values = wanted
    assert (found.onset_s, found.end_s) == (onset_s, end_s)
    assert found.explained == pytest.approx(explained, rel=1e-5)
    assert found.score == pytest.approx(score, rel=1e-5, abs=1e-3)
    np.testing.assert_allclose(found.values, values, rtol=1e-4)
    # the true effect lies on this grid's windows
    if cause == "heat_source at shell" and nuisance == "none":
        assert (onset_s, end_s) == (705.0, 1705.0)
        assert values[0] == pytest.approx(0.8, abs=0.05)


def test_what_the_prior_is_sure_of_is_not_fitted_again(seen, noise, candidates) -> None:
    """A nuisance that looks like the effect: free, it takes all of it; held to zero, nothing; in doubt, a part."""
    candidate = replace(candidates["heat_source at shell"], window=(705.0, 1705.0))
    (term,) = candidate.terms(seen)
    like = beginning(seen, term, [705.0])[0] - ending(seen, term, [1705.0])[0]
    wobble = 1e-3 * np.sin(TIME_S / 97)
    found = {}
    for name, sure in (("free", 0.0), ("in doubt", 30.0), ("for sure", 1e6)):
        frame = Regression.of([seen], noise, [np.array([like + wobble])], (np.array([[sure]]), np.zeros(1)))
        found[name] = frame
    alone = Regression.of([seen], noise)
    assert found["free"].square < found["in doubt"].square < found["for sure"].square
    assert found["for sure"].square == pytest.approx(alone.square, rel=1e-6)
    sure, plain = (scored(each, candidate, []) for each in (found["for sure"], alone))
    assert sure is not None
    assert sure.values[0] == pytest.approx(plain.values[0], rel=1e-4)
    # prior_rows rows are none that were measured
    assert found["for sure"].rows == alone.rows


def test_whole_and_onset_only(seen, noise, candidates) -> None:
    frame = Regression.of([seen], noise, [])
    whole = scored(frame, replace(candidates["heat_source at shell"], span=Span.WHOLE), ONSETS)
    assert whole is not None
    assert whole.onset_s is None
    assert whole.end_s is None
    onset = scored(frame, replace(candidates["heat_source at shell"], span=Span.ONSET), ONSETS)
    assert onset is not None
    assert onset.end_s is None


def test_a_fixed_coefficient_is_not_fitted(seen, noise, candidates) -> None:
    candidate = replace(candidates["heat_source at shell"], fixed=(0.5,), window=(705.0, 1705.0))
    frame = Regression.of([seen], noise, [])
    found = scored(frame, candidate, ONSETS)
    assert found is not None
    np.testing.assert_array_equal(found.values, [0.5])
    on, off = frame.columns(candidate, [705.0])[0, 0], frame.ends(candidate, [1705.0])[0, 0]
    left = frame.left - 0.5 * (on - off)
    assert found.explained == pytest.approx(frame.square - left @ left, rel=1e-6)


def test_what_was_normal_is_no_change(chain, noise, candidates) -> None:
    """Heat that the known-good record holds as well explains nothing; more of it, only the rest."""

    def always(watts: float):
        return lambda t, x, air: np.array([0.0, 0.0, watts / 40])

    candidate = replace(candidates["heat_source at shell"], span=Span.WHOLE)
    normal = Regression.of([_seen(chain, 3, always(0.6))], noise, [])
    same = Regression.of([_seen(chain, 4, always(0.6))], noise, [], normal=normal)
    more = Regression.of([_seen(chain, 5, always(1.0))], noise, [], normal=normal)
    alone = Regression.of([_seen(chain, 5, always(1.0))], noise, [])
    found = {name: scored(each, candidate, []) for name, each in (("same", same), ("more", more), ("alone", alone))}
    assert all(each is not None for each in found.values())
    assert abs(found["same"].values[0]) < 0.1
    assert found["more"].values[0] == pytest.approx(0.4, abs=0.1)
    assert found["alone"].values[0] == pytest.approx(1.0, abs=0.1)
    assert 20 * found["same"].score < found["more"].score < found["alone"].score


def test_rows_that_were_not_measured_tell_nothing(seen, noise) -> None:
    frame = Regression.of([seen], noise)
    known = ~np.isnan(noise.white(seen.residual_degC))
    assert frame.rows == known.sum() == 3 * (N - ORDER) - (10 + ORDER)
    assert not frame.left[~known.reshape(-1)].any()


def test_refinement_finds_the_edges_between_the_grid(chain, seen, noise, candidates) -> None:
    frame = Regression.of([seen], noise, [])
    coarse = scored(frame, candidates["heat_source at shell"], [float(each) for each in range(250, 2600, 170)])
    assert coarse is not None
    found = refined(frame, coarse, 170.0)
    assert found.score >= coarse.score
    assert found.onset_s == pytest.approx(705.0, abs=25.0)
    assert found.end_s == pytest.approx(1705.0, abs=25.0)
    assert found.values[0] == pytest.approx(0.8, abs=0.04)


@pytest.mark.parametrize("first", [250.0, 310.0, 610.0])
@pytest.mark.parametrize("memory", [0.0, 0.5])
def test_a_fault_that_slews_is_found_to_the_sample(chain, first: float, memory: float) -> None:
    """A bias that comes and goes within 90 s, which is in the middle of it; the coarse grid is minutes off.

    By noise that remembers, it shows at its edges the most.
    """
    slow = type(chain)(chain.circuit, 20.0)
    inputs = slow.inputs(400, 6)
    at = 20.0 * np.arange(400)
    bias = np.clip((at - 2005.0) / 90.0, 0.0, 1.0) - np.clip((at - 5305.0) / 90.0, 0.0, 1.0)
    nodes = slow.integrated(inputs, START)
    read = nodes + 0.03 * np.random.default_rng(8).standard_normal(nodes.shape) + np.outer([0, 1.0, 0], bias)
    own = view(slow.model(), slow.record(inputs, read))
    frame = Regression.of([own], replace(slow.noise(0.03), memory=np.array([[memory, 0.0, 0.0, 0.0]] * 3)))
    candidate = slow.candidate(own.record, "sensor_bias at board")
    coarse = scored(frame, candidate, [float(each) for each in np.arange(first, 7800.0, 540.0)])
    assert coarse is not None
    assert max(abs(coarse.onset_s - 2050.0), abs(coarse.end_s - 5350.0)) > 100.0
    found = refined(frame, coarse, 540.0)
    assert found.onset_s == pytest.approx(2050.0, abs=20.0)
    assert found.end_s == pytest.approx(5350.0, abs=20.0)
    assert found.values[0] == pytest.approx(1.0, abs=0.02)


def test_refinement_finds_the_shape(chain, noise) -> None:
    """A body of 300 s at the board is found from a grid of time constants that lacks it."""

    def mass(t: float, x: np.ndarray, air: float) -> np.ndarray:
        flow = (x[1] - x[3]) * 0.05
        return np.array([0.0, -flow / 25, 0.0, flow / 15])

    inputs = chain.inputs(N)
    nodes = chain.integrated(inputs, np.append(START, START[1]), mass)[:3]
    read = nodes + 0.01 * np.random.default_rng(3).standard_normal(nodes.shape)
    own = view(chain.model(), chain.record(inputs, read))
    frame = Regression.of([own], chain.noise(0.01), [])
    bodies = [
        each for each in all_candidates(setting_of(chain.model(), [own])) if str(each.cause) == "thermal_mass at board"
    ]
    coarse = max(
        filter(None, (scored(frame, replace(each, span=Span.WHOLE), []) for each in bodies)), key=lambda s: s.score
    )
    found = refined(frame, coarse, 100.0)
    assert found.candidate.shape == pytest.approx(300.0, rel=0.15)
    assert found.score >= coarse.score
