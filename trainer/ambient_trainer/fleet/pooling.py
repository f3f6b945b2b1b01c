"""Partial pooling of linear-Gaussian units, from normal equations alone (empirical Bayes).

    y_u = Z_u c_u + noise,    c_u ~ N(mean, between),    information L_u = Z'Z / (variance * tau)

``tau`` is the autocorrelation time of the noise: so much time counts as one sample. Mean and between-unit covariance
maximise the marginal likelihood by expectation-maximisation (Dempster, Laird and Rubin, J. R. Stat. Soc. B 39(1),
1977). A unit that lies far outside, or leaves far more than others, loses its weight (a redescending M-estimator: Huber
and Ronchetti, Robust Statistics, 2009, section 4.8), so that a broken one does not bend them. Groups of units are one
level more: their means are N(mean, between-group covariance), and the same function gives their posteriors from what
their units say of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ambient_trainer.data.trace import Array

_WIDE = 3.0
"""Ratio of squared to expected deviation up to which a unit has full weight: 5e-5 of normal units exceed it."""
_ROUNDS = 60
_START_DEGC2 = 0.02
_LEAST_DEGC2 = 1e-4
_COUNTS_AS = 2.0
"""Units that the prior of the between-unit covariance counts as."""
_RIDGE = 1e-9
_WORSE, _SURE = 1.05, 3.0
"""Bound on a unit's error by its own data, relative to the population's, and standard deviations at which it holds."""
_QUARTILES_APART = 1.349
"""Of a standard normal number."""


class NormalEquations(NamedTuple):
    """Normal equations in p coordinates, of one log or of u: H = Z'Z (u, p, p), g = Z'r (u, p), r'r (u,), time (u,).

    Samples are weighed by their period, so all four are integrals over time, in s.
    """

    H: Array
    g: Array
    square: Array
    seconds: Array

    @classmethod
    def of_samples(cls, Z: Array, r: Array, weight_s: Array) -> NormalEquations:
        """Those of regressors (p, N) and residuals (N,)."""
        weighed = Z * weight_s
        return cls(weighed @ Z.T, weighed @ r, weight_s @ r**2, weight_s.sum())

    @classmethod
    def stacked(cls, each: Iterable[NormalEquations]) -> NormalEquations:
        """Those of several logs."""
        return cls(*(np.array(part) for part in zip(*each)))

    def total(self) -> NormalEquations:
        """Those of all together."""
        return NormalEquations(*(each.sum(axis=0) for each in self))

    def squares(self, c: Array) -> Array:
        """Per unit the sum of squared errors at coordinates c (u, p)."""
        return np.asarray(np.maximum(self.square + ((_times(self.H, c) - 2 * self.g) * c).sum(axis=-1), 0.0))


class Posterior(NamedTuple):
    """Means (u, p) and covariances (u, p, p), and the information on the prior's mean: (u, p, p) and (u, p)."""

    mean: Array
    covariance: Array
    information: Array
    vector: Array


def posterior(information: Array, vector: Array, mean: Array, between: Array) -> Posterior:
    """Posterior of units with likelihood exp(-c'Lc/2 + e'c) under c ~ N(mean, between).

    With K = (I + L S)^-1 it is N(m + S K (e - L m), S - S K L S), and the unit says of m the information K L and the
    vector K e. ``information`` L (u, p, p) may lack rank; ``mean`` is (p,) or (u, p).
    """
    p = len(between)
    K = np.linalg.inv(np.eye(p) + information @ between)
    means = np.broadcast_to(mean, vector.shape)
    seen = K @ information
    projected = np.einsum("uij,uj->ui", K, vector)
    pull = projected - np.einsum("uij,uj->ui", seen, means)
    covariance = between - between @ seen @ between
    return Posterior(means + pull @ between, (covariance + covariance.swapaxes(1, 2)) / 2, seen, projected)


@dataclass(frozen=True)
class Population:
    """The prior of a unit: mean (p,) and between-unit covariance (p, p) within a group, and how they were found.

    ``variance_degC2`` is that of the noise, ``correlation_s`` its autocorrelation time; ``groups`` (k, p) are the
    means of the groups and ``group_covariance`` (k, p, p) how well they are known; ``group_between`` (p, p) is
    the covariance of groups about ``mean``, zero where there is one.
    """

    mean: Array
    mean_covariance: Array
    between: Array
    variance_degC2: float
    correlation_s: float
    groups: Array
    group_covariance: Array
    group_between: Array
    units: int

    def prior(self, group: NDArray[np.intp]) -> tuple[Array, Array]:
        """Mean (u, p) and covariance (p, p) of units of the groups; -1 is a group that was never seen."""
        known = np.where((group >= 0)[:, None], self.groups[np.maximum(group, 0)], self.mean)
        return known, self.between

    def posterior(self, units: NormalEquations, group: NDArray[np.intp]) -> Posterior:
        """Posterior of each unit given its own log."""
        scale = self.variance_degC2 * self.correlation_s
        mean, between = self.prior(group)
        return posterior(units.H / scale, units.g / scale, mean, between)

    def bounded_shrinkage(self, post: Posterior) -> tuple[Posterior, Array]:
        """Bounded shrinkage: posteriors shrunk to the population until no harm is likely, and the share each keeps.

        Coordinates are white over the population's use: where a unit's truth is t ~ N(a, V) from the population's
        mean, keeping a share w of a changes its mean square error by w^2 a'a - 2 w a't. The share is the largest whose
        error exceeds ``_WORSE`` times the population's in one unit of a thousand. What is given up widens V.
        """
        own = post.mean - self.mean
        length = np.maximum((own**2).sum(axis=1), 1e-300)
        sure = length - _SURE * np.sqrt(np.einsum("ui,uij,uj->u", own, post.covariance, own))
        room = (_WORSE**2 - 1) * self.variance_degC2 * length
        share = np.minimum(1.0, (sure + np.sqrt(sure**2 + room)) / length)
        given_up = (1 - share)[:, None] * own
        covariance = post.covariance + given_up[:, :, None] * given_up[:, None, :]
        return post._replace(mean=post.mean - given_up, covariance=covariance), share

    @property
    def summary(self) -> dict[str, float]:
        """Number of units it was estimated from, and standard deviations: of the residual and between units."""
        noise, between = np.sqrt([self.variance_degC2, np.trace(self.between)]).tolist()
        errors = {"noise_degC": noise, "between_units_degC": between}
        return {"learnt_from": self.units, "memory_s": self.correlation_s, **errors}

    def deviation_degC(self, covariance: Array) -> Array:
        """Of the error to expect: the noise, and what is not known of gains (..., p, p), over the population's use."""
        return np.sqrt(self.variance_degC2 + np.trace(covariance, axis1=-2, axis2=-1))

    @property
    def unseen_degC(self) -> float:
        """Of the error to expect of a unit that was never seen, about ``mean``."""
        return float(self.deviation_degC(self.between + self.group_between + self.mean_covariance))


def pooled(units: NormalEquations, group: NDArray[np.intp], tau_s: float) -> Population:
    """The population of two or more ``units``, each of a group numbered from 0; autocorrelation time ``tau_s``."""
    u, p = units.g.shape
    groups = int(group.max()) + 1
    member = np.eye(groups)[group]
    unity = np.eye(p)
    between, group_between = _START_DEGC2 * unity, _START_DEGC2 * unity * (groups > 1)
    prior = _COUNTS_AS * _LEAST_DEGC2 * unity
    variance = float(np.median(units.square / units.seconds))
    weight: Array = np.ones(u)
    mean: Array = np.zeros(p)
    for _ in range(_ROUNDS):
        scale = variance * tau_s
        # in coordinates in which the units of a group are N(centre, I): R is the posterior covariance, I - R is known
        white = np.linalg.cholesky(between)
        whiten = np.linalg.inv(white)
        M, f = white.T @ units.H @ white / scale, units.g @ white / scale
        R = np.linalg.inv(unity + M)
        weighed = member * weight[:, None]
        projected = weighed.sum(axis=0)[:, None, None] * unity - np.tensordot(weighed, R, (0, 0))
        vectors = weighed.T @ _times(R, f)
        above_between = whiten @ group_between @ whiten.T
        above = posterior(projected, vectors, whiten @ mean, above_between)
        total = above.information.sum(axis=0)
        total += _RIDGE * np.trace(total) / p * unity
        middle = np.linalg.solve(total, above.vector.sum(axis=0))
        above = posterior(projected, vectors, middle, above_between)
        centre = above.mean[group]
        apart = _times(R, f - _times(M, centre))
        second = np.tensordot(weight, R, 1) + (apart * weight[:, None]).T @ apart
        mean, means = np.asarray(white @ middle, dtype=np.float64), above.mean @ white.T
        between = (white @ second @ white.T + prior) / (weight.sum() + _COUNTS_AS)
        if groups > 1:
            off = above.mean - middle
            apart_groups = above.covariance.sum(axis=0) + off.T @ off
            group_between = (white @ apart_groups @ white.T + prior) / (groups + _COUNTS_AS)
        open_ = np.trace(R, axis1=1, axis2=2)
        squares = units.squares((centre + apart) @ white.T)
        weight = _weight((apart**2).sum(axis=1), p - open_) * _weight(squares / scale, 1 + units.seconds / tau_s)
        variance = float((weight * (squares + scale * (p - open_))).sum() / (weight * units.seconds).sum())
    known, of_means = (white @ each @ white.T for each in (np.linalg.inv(total), above.covariance))
    return Population(mean, known, between, variance, tau_s, means, of_means, group_between, u)


def _times(matrices: Array, vectors: Array) -> Array:
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _weight(square: Array, expected: Array) -> Array:
    return np.minimum(1.0, _WIDE * expected / np.maximum(square, 1e-300)) ** 2


def deviance(information: Array, vector: Array, mean: Array, between: Array) -> tuple[Array, Array]:
    """How far each unit lies from the prior: squared Mahalanobis distance (u,), and its degrees of freedom (u,).

    Of q = e - L m, whose covariance under the prior is L + L S L; directions without information count for nothing.
    """
    p = len(between)
    q = vector - np.einsum("uij,uj->ui", information, np.broadcast_to(mean, vector.shape))
    whole = information + information @ between @ information
    ridge = _RIDGE * np.trace(whole, axis1=1, axis2=2)[:, None, None] / p * np.eye(p) + 1e-12 * np.eye(p)
    solved = np.linalg.solve(whole + ridge, q[..., None])[..., 0]
    freedom = np.trace(np.linalg.solve(whole + ridge, whole), axis1=1, axis2=2)
    return np.einsum("ui,ui->u", q, solved), freedom


def improbability(*squares: Array) -> Array:
    """Minus the decimal logarithm of how probable each unit is, from several squares (u,) that grow with what is odd.

    The logarithm of each is compared with the median and the quartiles of all units; the one-sided p-values are
    combined (Fisher, Statistical Methods for Research Workers, 1932, section 21.1). They are not independent: the
    numbers order units, and are no frequencies.
    """
    statistic = np.zeros(len(squares[0]))
    for each in squares:
        logarithm = np.log(np.maximum(each, 1e-12))
        low, middle, high = np.percentile(logarithm, [25, 50, 75])
        z = (logarithm - middle) / max((high - low) / _QUARTILES_APART, 1e-3)
        statistic -= 2 * stats.norm.logsf(z)
    return np.asarray(-stats.chi2.logsf(statistic, 2 * len(squares)) / np.log(10.0))
