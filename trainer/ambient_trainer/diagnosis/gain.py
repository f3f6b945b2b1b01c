"""What a cause is worth is measured on blocks of time that its coefficients have not seen, block by block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ambient_trainer.diagnosis.fit import FitResult, blocks
from ambient_trainer.diagnosis.result import Gain
from ambient_trainer.estimation.noise import ORDER, Noise

Array = NDArray[np.float64]

_RESAMPLES = 1000
_SEED = 20260


@dataclass(frozen=True)
class Blocks:
    """Per block of all records: the sum of squared errors, whitened and in degC by sensor, and how many there were."""

    white: Array
    square_degC2: Array
    count: Array

    @staticmethod
    def of(fitted: FitResult, noise: Noise) -> Blocks:
        """The held-out errors of ``fitted``; ``square_degC2`` and ``count`` have shape (blocks, s)."""
        white, square, count = [], [], []
        for view, error in zip(fitted.views, fitted.held_out_degC):
            block = blocks(view.record)
            whitened = np.nansum(noise.white(error) ** 2, axis=0)
            known = ~np.isnan(error)
            filled = np.where(known, error, 0.0) ** 2
            for index in range(block[-1] + 1):
                mine = block == index
                white.append(whitened[mine[ORDER:]].sum())
                square.append(filled[:, mine].sum(axis=1))
                count.append(known[:, mine].sum(axis=1))
        return Blocks(np.array(white), np.array(square), np.array(count, dtype=float))

    def rmse_degC(self) -> float:
        """Over all sensors."""
        return float(np.sqrt(self.square_degC2.sum() / max(1.0, self.count.sum())))

    def relative(self, noise: Noise) -> float:
        """The root mean square over all sensors, each in units of the noise's deviation."""
        weighted = self.square_degC2 / noise.deviation_degC**2
        return float(np.sqrt(weighted.sum() / max(1.0, self.count.sum())))


def gain(before: Blocks, after: Blocks, unknowns: float, tries: int) -> Gain:
    """The held-out gain, its interval by resampling blocks, and its significance over ``tries`` candidates.

    The p-value is that of the whitened square's fall on held-out rows, as if ``unknowns`` had been fitted to noise,
    times the candidates and windows that were tried (Bonferroni).
    """
    fall = float((before.white - after.white).sum())
    scale = max(1.0, float(after.white.sum()) / max(1.0, float(after.count.sum())))
    p_value = min(1.0, tries * float(chi2.sf(max(fall, 0.0) / scale, max(unknowns, 1.0))))
    random = np.random.default_rng(_SEED)
    drawn = random.integers(0, len(before.white), (_RESAMPLES, len(before.white)))
    old = np.sqrt(
        before.square_degC2.sum(axis=1)[drawn].sum(axis=1) / before.count.sum(axis=1)[drawn].sum(axis=1).clip(1)
    )
    new = np.sqrt(
        after.square_degC2.sum(axis=1)[drawn].sum(axis=1) / after.count.sum(axis=1)[drawn].sum(axis=1).clip(1)
    )
    low, high = np.quantile(old - new, (0.025, 0.975))
    return Gain(before.rmse_degC(), after.rmse_degC(), (float(low), float(high)), p_value)


def differ(one: Blocks, other: Blocks) -> float:
    """By how many standard errors the whitened held-out squares of two models differ; positive if ``one`` is worse."""
    difference = one.white - other.white
    deviation = float(np.std(difference, ddof=1)) * np.sqrt(len(difference))
    return float(difference.sum() / deviation) if deviation > 0 else 0.0
