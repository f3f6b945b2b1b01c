"""The Gram matrices of all zones are computed once; then a candidate is scored from a few of their rows.

So the best of each size are found by a floating search, at the end of this module.

Every candidate filter shares one bank of fixed real poles, so its gains are a small least-squares problem: of each
sensor the bank phi holds the reading u and what K first-order lags 1 / (tau_j s + 1) make of it, of unit gain at rest
and in equilibrium with the first sample. A candidate's estimate is y = sum_i b_i' phi_i + offset. Its gains minimise,
over the samples that are fitted to,

    sum (T - y)^2 + n sum_i [ s^2 b_i' N b_i + (s^2 + q_i^2/12) (1' b_i)^2 ]    with    sum_i 1' b_i = 1.

All sensors one degree up are the estimate one degree up. The first penalty bounds what the estimate makes of white
noise of s degC, exactly (N is the bank's noise Gram); the second what it makes of a reading that stays off by s and by
what the rounding to q_i leaves: at rest a rounded reading does not average out. Leaving a block out subtracts its Gram.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data import Array, Segment
from ambient_trainer.estimation.validation import Block
from ambient_trainer.lti import StateSpace, lagged
from ambient_trainer.selection.screen import Sensor

_FASTEST_PERIODS = (1.0, 2.0, 5.0, 10.0)
_RATIOS = (3.0, 5.0, 8.0)
_TIMES_SHOWN = 20
_DECAYED = 20.0
"""Time constants after which nothing of an impulse is left."""

Sensors = tuple[int, ...]
"""A candidate: the numbers of its sensors, ascending."""


@dataclass(frozen=True)
class Grams:
    """Gram matrices over the bank of all sensors, a one and the reference, in this order: p = m (1 + K) + 2 rows.

    ``whole`` (p, p) and ``fitted_to`` (blocks, p, p), of the samples outside a block and its gaps, carry the penalty;
    ``held`` (blocks, p, p) does not.
    """

    poles_s: tuple[float, ...]
    sensors: int
    whole: Array
    fitted_to: Array
    held: Array
    samples: Array
    """(blocks,): with a reference, held out."""

    def squares(self, candidates: Sequence[Sensors]) -> Array:
        """Per candidate and block the sum of squared errors in degC^2, (c, blocks), fitted to the other blocks.

        All candidates must be of one size.
        """
        rows, last = self._rows(candidates), self.whole.shape[0] - 1
        pick = rows[:, :, None], rows[:, None, :]
        found = np.empty((len(candidates), len(self.held)))
        for block, (fitted_to, held) in enumerate(zip(self.fitted_to, self.held)):
            b = _unit_gain(fitted_to[pick], fitted_to[rows, last])
            curved = np.einsum("ci,cij,cj->c", b, held[pick], b)
            found[:, block] = curved - 2 * np.einsum("ci,ci->c", b, held[rows, last]) + held[last, last]
        return np.maximum(found, 0.0)

    def rmse_degC(self, candidates: Sequence[Sensors]) -> list[float]:
        """The held-out error of each candidate; all are of one size."""
        return np.sqrt(self.squares(candidates).sum(axis=1) / self.samples.sum()).tolist() if candidates else []

    def fitted(self, candidate: Sensors) -> StateSpace:
        """The continuous filter of all samples, with a state a pole."""
        rows, last = self._rows([candidate]), self.whole.shape[0] - 1
        b = _unit_gain(self.whole[rows[:, :, None], rows[:, None, :]], self.whole[rows, last])[0]
        gains, rates = b[:-1].reshape(len(candidate), -1), 1 / np.asarray(self.poles_s, dtype=float)
        B, C = gains[:, 1:].T * rates[:, None], np.ones((1, len(rates)))
        return StateSpace(-np.diag(rates), B, C, gains[:, :1].T, b[-1:])

    def _rows(self, candidates: Sequence[Sensors]) -> NDArray[np.intp]:
        """The rows of each candidate's bank and of the one, (c, 1 + size (1 + K))."""
        width = 1 + len(self.poles_s)
        bank = np.asarray(candidates, dtype=np.intp)[:, :, None] * width + np.arange(width)
        one = np.full((len(candidates), 1), self.sensors * width, dtype=np.intp)
        return np.concatenate([bank.reshape(len(candidates), -1), one], axis=1)


def banks(order: int, period_s: float, longest_s: float) -> list[tuple[float, ...]]:
    """The banks to choose from: ``order`` time constants in s, fastest first, in one ratio each.

    The slowest is shown twenty times by the longest stretch: one that is shown once or twice is the run's age.
    """
    found = [
        tuple(float(f"{fastest * period_s * ratio**k:.4g}") for k in range(order))
        for fastest in _FASTEST_PERIODS
        for ratio in _RATIOS
    ]
    shown = [each for each in found if each[-1] <= longest_s / _TIMES_SHOWN]
    return list(dict.fromkeys(shown or [min(found, key=lambda each: each[-1])]))


def low_passes(readings: Array, poles_s: Sequence[float], period_s: float) -> Array:
    """The bank over ``readings`` (m, N): shape (m, 1 + K, N), the reading itself first."""
    return np.stack([readings, *(lagged(readings, tau_s, period_s) for tau_s in poles_s)], axis=1)


def noise_gram(poles_s: Sequence[float], period_s: float) -> Array:
    """N (1 + K, 1 + K), the impulse responses' inner products: b' N b is the variance that b makes of white noise."""
    # after a first sample, which sets the equilibrium
    impulse = np.eye(1, 2 + round(_DECAYED * max(poles_s, default=0.0) / period_s), 1)
    [responses] = low_passes(impulse, poles_s, period_s)
    return np.asarray(responses @ responses.T)


def gathered(
    segments: Sequence[Segment],
    blocks: Sequence[Block],
    sensors: Sequence[Sensor],
    poles_s: tuple[float, ...],
    tolerance_degC: float,
) -> Grams:
    """The Gram matrices of ``segments``, whose inputs are ``sensors`` and whose first output is the reference."""
    # gains that sum to one say the same about any level; near it the sums keep their digits
    level = float(np.nanmean(np.concatenate([each.outputs[0] for each in segments])))
    tables = []
    for each in segments:
        bank, count = low_passes(each.inputs - level, poles_s, each.period_s), each.inputs.shape[1]
        tables.append(np.concatenate([bank.reshape(-1, count), np.ones((1, count)), each.outputs[:1] - level]))
    counts = [~np.isnan(each.outputs[0]) for each in segments]
    whole = sum((_gram(table, count) for table, count in zip(tables, counts)), np.zeros((1, 1)))
    penalty = _penalty(sensors, poles_s, segments[0].period_s, tolerance_degC)
    total = sum(int(each.sum()) for each in counts)
    held, fitted_to, samples = [], [], []
    for block in blocks:
        table, count = tables[block.segment], counts[block.segment]
        out, near = slice(block.start, block.stop), slice(block.first, block.last)
        held.append(_gram(table[:, out], count[out]))
        fitted_to.append(whole - _gram(table[:, near], count[near]) + (total - int(count[near].sum())) * penalty)
        samples.append(int(count[out].sum()))
    by_block = np.array(fitted_to), np.array(held), np.array(samples, dtype=np.float64)
    return Grams(poles_s, len(sensors), whole + total * penalty, *by_block)


def _gram(table: Array, counts: NDArray[np.bool_]) -> Array:
    rows = table if counts.all() else table[:, counts]
    return np.asarray(rows @ rows.T)


def _penalty(sensors: Sequence[Sensor], poles_s: tuple[float, ...], period_s: float, tolerance_degC: float) -> Array:
    """What one sample adds for the sensors' errors, (p, p)."""
    width = 1 + len(poles_s)
    still = tolerance_degC**2 + np.array([each.step_degC for each in sensors]) ** 2 / 12
    noisy = np.kron(np.eye(len(sensors)), tolerance_degC**2 * noise_gram(poles_s, period_s))
    found = np.zeros((len(sensors) * width + 2,) * 2)
    found[:-2, :-2] = noisy + np.kron(np.diag(still), np.ones((width, width)))
    return found


def _unit_gain(gram: Array, moment: Array) -> Array:
    """argmin b' G b - 2 g' b (c, p) whose gains sum to one, c' b = 1; the last, an offset, is no gain.

    b = G^-1 g - G^-1 c (c' G^-1 g - 1) / (c' G^-1 c).
    """
    unit = np.arange(gram.shape[-1]) < gram.shape[-1] - 1.0
    solved = np.linalg.solve(gram, np.stack([moment, np.broadcast_to(unit, moment.shape)], axis=-1))
    free, by_unit = solved[..., 0], solved[..., 1]
    return np.asarray(free - by_unit * ((free @ unit - 1) / (by_unit @ unit))[..., None])


Score = Callable[[Sequence[Sensors]], Sequence[float]]
"""The held-out error of each candidate; all of one size."""

_BEAM = 6
_ROUNDING = 1e-9


def best_sets(allowed: Sequence[int], most: int, score: Score) -> list[Sensors]:
    """The best set found of every size from 1 to ``most``, or to as many as are allowed, by floating search.

    A beam of good sets grows; then any member may be swapped for any other sensor, round after round; and where a grown
    set less one member beats the best smaller set, it goes back to that size (Pudil, Novovicova and Kittler 1994,
    Pattern Recognition Letters 15). Plain forward selection keeps its first choices for ever.
    """
    beams: dict[int, list[tuple[float, Sensors]]] = {0: [(0.0, ())]}
    size, last = 1, min(most, len(allowed))
    while size <= last:
        pool = grown([each for _, each in beams[size - 1]], allowed)
        pool |= {each for _, each in beams.get(size, [])}
        beams[size] = _swapped(_ranked(pool, score), allowed, score)
        fewer = _ranked(thinned([each for _, each in beams[size]]), score) if size > 1 else []
        if fewer and fewer[0][0] < beams[size - 1][0][0] - _ROUNDING:
            beams[size - 1] = sorted(set(fewer + beams[size - 1]))[:_BEAM]
            size -= 1
        else:
            size += 1
    return [beams[each][0][1] for each in range(1, last + 1)]


def thinned(sets: Iterable[Sensors]) -> set[Sensors]:
    """The sets less one member each."""
    return {tuple(each for each in members if each != out) for members in sets for out in members}


def grown(sets: Iterable[Sensors], allowed: Sequence[int]) -> set[Sensors]:
    """The sets with one more of the allowed sensors each."""
    return {tuple(sorted((*members, new))) for members in sets for new in allowed if new not in members}


def _swapped(beam: list[tuple[float, Sensors]], allowed: Sequence[int], score: Score) -> list[tuple[float, Sensors]]:
    """The beam after rounds of swaps, until its best gains no more."""
    while True:
        members = {each for _, each in beam}
        better = _ranked(members | grown(thinned(members), allowed), score)
        if better[0][0] >= beam[0][0] - _ROUNDING:
            return better
        beam = better


def _ranked(sets: Iterable[Sensors], score: Score) -> list[tuple[float, Sensors]]:
    """The best of ``sets``; between equals the one that was logged first, so that every run finds the same."""
    ordered = sorted(sets)
    return sorted(zip(score(ordered), ordered))[:_BEAM]
