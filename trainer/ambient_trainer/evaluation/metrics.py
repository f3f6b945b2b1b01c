"""The thesis's figures of merit (its section 3.4): an error is true minus estimate, in degC.

RMSE, MAE and MBE are means over the samples; an interval is mu +- lambda sigma, with sigma over N - 1 and lambda the
quantile of the normal distribution: where one single error lies, if errors are normally distributed.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import norm

from ambient_model.model import LEVELS_PERCENT, SCORES, Quantiles
from ambient_trainer.data.trace import Array

ROLLING_SAMPLES = 20
ROLLING_LEVEL_PERCENT = 98
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Metrics:
    """How wrong an estimate is over ``samples`` samples, in degC; ``interval_degC`` is by level in percent."""

    samples: int
    rmse_degC: float
    mae_degC: float
    mbe_degC: float
    sigma_degC: float
    interval_degC: Quantiles


def score(error_degC: Array) -> Metrics:
    """The metrics of errors of shape (n,), n >= 2, none missing."""
    mean, sigma = float(np.mean(error_degC)), float(np.std(error_degC, ddof=1))
    return Metrics(
        samples=len(error_degC),
        rmse_degC=float(np.sqrt(np.mean(error_degC**2))),
        mae_degC=float(np.mean(np.abs(error_degC))),
        mbe_degC=mean,
        sigma_degC=sigma,
        interval_degC={level: (mean - _reach(level) * sigma, mean + _reach(level) * sigma) for level in LEVELS_PERCENT},
    )


def coverage(error_degC: Array, interval: Quantiles, scale: Array | float = 1.0) -> dict[int, float]:
    """Per level of a published interval the share, 0 to 1, of the errors that lie inside it, ends included.

    The interval is in units of ``scale`` (degC): one number, or one for each error.
    """
    return {
        level: float(np.mean((low * scale <= error_degC) & (error_degC <= high * scale)))
        for level, (low, high) in interval.items()
    }


def widened_coverage(
    error_degC: Array, published90_degC: Array, interval: Quantiles, scale: Array | float = 1.0
) -> dict[int, float]:
    """The same of an interval that a device widens by a variance; its 90 % one, less the estimate, is (2, n)."""
    own = np.multiply.outer(np.array(interval[90]), scale).reshape(2, -1)
    added = published90_degC**2 - own**2
    added = np.where(added > _ROUNDING * own**2, added, 0.0)
    shares = {}
    for level, quantiles in interval.items():
        ends = np.multiply.outer(np.array(quantiles), scale).reshape(2, -1)
        reach = np.sqrt(ends**2 + added * (SCORES[level] / SCORES[90]) ** 2)
        low, high = np.where(added > 0, np.array([[-1.0], [1.0]]) * reach, ends)
        shares[level] = float(np.mean((low <= error_degC) & (error_degC <= high)))
    return shares


def rolling_band(error_degC: Array) -> tuple[Array, Array]:
    """The 98 % interval of 20 successive errors at the centre of each window: low and high, both of shape (n,).

    The value at k is of the errors k - 10 to k + 9; the first 10 and the last 10 values repeat the nearest window's.
    A missing error (NaN) is left out of the windows and its own value is NaN; with fewer than 20 errors all are NaN.
    """
    known = pd.Series(error_degC).dropna()
    windows = known.rolling(ROLLING_SAMPLES, center=True)
    mean, reach = windows.mean(), _reach(ROLLING_LEVEL_PERCENT) * windows.std()
    every = range(len(error_degC))
    low, high = (ends.bfill().ffill().reindex(every).to_numpy() for ends in (mean - reach, mean + reach))
    return low, high


def _reach(level_percent: float) -> float:
    """Standard deviations from the mean within which that share of a normal distribution lies."""
    return float(norm.ppf(0.5 + level_percent / 200))
