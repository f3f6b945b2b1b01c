"""Lower bound of the error: what a flexible black box with a model's inputs leaves on held-out blocks of time.

It reads the past of the inputs, never a sensor. Its features are exponential moving averages of every input over a
ladder of time constants, which are the states of all first-order lags; of squares, products and pieces of the inputs
above their quartiles; and decays from the start, which stand for the unknown initial state. For each sensor the best of
three regressions counts, by the held-out error itself: ridge on the linear features, ridge on all, and extremely
randomised trees on what linear ridge leaves (Geurts et al. 2006). That choice lowers the floor, by little.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.ensemble import ExtraTreesRegressor

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lag_weights

_LADDER = 3.0
"""Ratio of neighbouring time constants: a lag between two is a mixture of them within 2 % of its step."""
_GAP = 10.0
"""In median steps; a longer one starts the averages anew."""
_MOST_PRODUCTS = 120
"""Those of fifteen inputs; of more only the squares, so that it stays quick."""
_MOST_AVERAGES = 1000
"""Of products and pieces; beyond, every second or third constant has to do, or ridge takes longer than the rest."""
_PENALTIES = 10.0 ** np.arange(-8.0, 2.0)
"""Ridge, per unit variance of a feature."""
_TREES, _SMALLEST_LEAF = 25, 5


def black_box_rmse_degC(time_s: Array, inputs: Mapping[str, Array], outputs: Array, blocks: Sequence[slice]) -> float:
    """RMSE over all sensors and blocks of :func:`black_box_residual_degC`."""
    return float(np.sqrt(np.nanmean(black_box_residual_degC(time_s, inputs, outputs, blocks) ** 2)))


def black_box_residual_degC(
    time_s: Array, inputs: Mapping[str, Array], outputs: Array, blocks: Sequence[slice]
) -> Array:
    """Measured minus predicted on blocks of time, each predicted by a black box that was fitted to the others.

    ``time_s`` (N,) increases at any spacing. ``inputs``, (N,) each, may drive the sensors: the ambient and every logged
    column, never a sensor; their gaps are bridged by lines. ``outputs`` (m, N) are in degC, NaN where nothing was
    measured; so is the result, which is NaN outside the ``blocks`` of samples, too.
    """
    steps_s = np.diff(time_s)
    edges = [0, *(np.flatnonzero(steps_s > _GAP * np.median(steps_s)) + 1).tolist(), len(time_s)]
    stretches = [slice(start, stop) for start, stop in itertools.pairwise(edges)]
    longest_s = max(time_s[each][-1] - time_s[each][0] for each in stretches)
    step_s = float(np.median(steps_s))
    constants_s = step_s * _LADDER ** np.arange(-0.5, max(1.0, np.log(max(longest_s / step_s, 1.0)) / np.log(_LADDER)))
    bridged = pd.DataFrame(inputs, dtype=float).interpolate(limit_direction="both").fillna(0.0)
    columns = _normal(bridged.to_numpy().T.reshape(-1, len(time_s)))
    since_s = np.concatenate([time_s[part] - time_s[part.start] for part in stretches])
    decays = np.exp(-since_s / constants_s[:, None])
    linear = np.vstack([columns, _averages(columns, time_s, stretches, constants_s), decays])
    bent = _bent(columns)
    thinned_s = constants_s[:: 1 + len(bent) * len(constants_s) // _MOST_AVERAGES]
    every = np.vstack([linear, bent, _averages(bent, time_s, stretches, thinned_s)])
    straight = _ridge(linear, outputs, blocks)
    left = outputs - straight
    rivals = [left, outputs - _ridge(every, outputs, blocks), left - _trees(linear, left, blocks)]
    best = np.argmin([np.nanmean(each**2, axis=1) for each in rivals], axis=0)
    return np.array([rivals[choice][sensor] for sensor, choice in enumerate(best)])


def _normal(rows: Array) -> Array:
    """Rows of mean 0 and variance 1, without those that never change."""
    varying = rows[np.ptp(rows, axis=1) > 0]
    return np.asarray((varying - varying.mean(axis=1, keepdims=True)) / varying.std(axis=1, keepdims=True))


def _averages(rows: Array, time_s: Array, stretches: Sequence[slice], constants_s: Array) -> Array:
    """First-order lags of every row, one of each constant, that start each stretch in steady state."""
    weights = lag_weights(constants_s[:, None, None], np.diff(time_s, prepend=time_s[0]))
    kept, before, now = (np.moveaxis(each, -1, 0) for each in weights)
    averages = np.empty((len(time_s), len(constants_s), len(rows)))
    for part in stretches:
        averages[part.start] = rows[:, part.start]
        for k in range(part.start + 1, part.stop):
            averages[k] = kept[k] * averages[k - 1] + before[k] * rows[:, k - 1] + now[k] * rows[:, k]
    return averages.reshape(len(time_s), -1).T


def _bent(columns: Array) -> Array:
    """What is above each quartile, which side of the mean, and every product of two, in variance 1."""
    quartiles = np.quantile(columns, (0.25, 0.5, 0.75), axis=1)
    pieces = [np.maximum(columns - each[:, None], 0.0) for each in quartiles]
    one, other = np.triu_indices(len(columns))
    if len(one) > _MOST_PRODUCTS:
        one = other = np.arange(len(columns))
    return _normal(np.vstack([*pieces, columns > 0.0, columns[one] * columns[other]]))


def _ridge(features: Array, outputs: Array, blocks: Sequence[slice]) -> Array:
    """Held-out predictions of the best penalty for each sensor, NaN outside the blocks."""
    predicted = np.full((len(_PENALTIES), *outputs.shape), np.nan)
    scale = features.std(axis=1, keepdims=True) + 1e-9
    for block, known, sensors in _parts(outputs, blocks):
        mean = features[:, known].mean(axis=1, keepdims=True)
        trained, held_out = (features[:, known] - mean) / scale, (features[:, block] - mean) / scale
        variances, directions = np.linalg.eigh(trained @ trained.T / len(known))
        level = outputs[np.ix_(sensors, known)].mean(axis=1, keepdims=True)
        along = (outputs[np.ix_(sensors, known)] - level) @ trained.T @ directions / len(known)
        seen = directions.T @ held_out
        for each, penalty in zip(predicted, _PENALTIES):
            each[sensors, block] = level + along / (np.maximum(variances, 0.0) + penalty) @ seen
    error = np.array([np.nanmean((outputs - each) ** 2, axis=1) for each in predicted])
    return predicted[error.argmin(axis=0), np.arange(len(outputs))]


def _trees(features: Array, outputs: Array, blocks: Sequence[slice]) -> Array:
    predicted = np.full(outputs.shape, np.nan)
    for block, known, sensors in _parts(outputs, blocks):
        trees = ExtraTreesRegressor(_TREES, min_samples_leaf=_SMALLEST_LEAF, max_features=1 / 3, random_state=0)
        wanted = outputs[np.ix_(sensors, known)].T
        trees.fit(features[:, known].T, wanted if len(sensors) > 1 else wanted[:, 0])
        predicted[sensors, block] = trees.predict(features[:, block].T).reshape(-1, len(sensors)).T
    return predicted


def _parts(outputs: Array, blocks: Sequence[slice]) -> Iterator[tuple[slice, NDArray[np.intp], NDArray[np.intp]]]:
    """Each block, samples outside it where sensors are measured, and the sensors that share them."""
    for block in blocks:
        measured = ~np.isnan(outputs)
        measured[:, block] = False
        for pattern in np.unique(measured, axis=0):
            yield block, np.flatnonzero(pattern), np.flatnonzero((measured == pattern).all(axis=1))
