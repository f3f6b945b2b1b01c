"""Coordinates in which units are pooled: the gains of the population's filter at fixed time constants.

Whatever the estimator is, its fit is a linear system. With the responses of its modes to each input,
x_j = (sI - A)^-1 b u_j,

    y = offset + sum_j (d_j u_j + g_j' x_j)

holds every filter with the same poles; units differ in d, g and the offset, which enter linearly. They are scaled so
that the population's regressors are white: each of the coordinates is then what it changes in the estimate (RMS, degC).
So sensors that go together, which no short log distinguishes, do not make the prior singular.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import schur

from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data import Array, Segment, Trace, segments
from ambient_trainer.estimation.uncertainty import autocorrelation_time
from ambient_trainer.estimators import Fit
from ambient_trainer.estimators.model_file import MAIN, SECONDARY, WITHOUT
from ambient_trainer.fleet.pooling import NormalEquations
from ambient_trainer.lti import Hold, StateSpace, discretised, equilibrium, states

BLOCKS = 5
"""A unit's log is cut in so many for its held-out error; as many as `fit` takes for its own."""
_BRIDGED_S = 120.0
_LEAST_RMS_DEGC = 1e-3
"""A direction in which the population's regressors move less says nothing of any unit."""
_WEAK_DEGC = 0.5
"""The standard deviation of the weak prior under which a unit's residuals are looked at."""
_NOISE_DEGC2, _CORRELATION_S = 0.1, 100.0


@dataclass(frozen=True)
class Space:
    """Coordinates of the filters with the poles of one fit.

    ``modes`` (n, n) is A in real Schur form, ``drive`` (n,) b, ``weights`` (P, p) turn coordinates into changes of the
    P raw gains, whose values at the origin are ``origin`` (P,).
    """

    inputs: tuple[str, ...]
    modes: Array
    drive: Array
    scale: Array
    hold: Hold
    origin: Array
    weights: Array

    @property
    def slowest_s(self) -> float:
        """The longest time constant; 0 of a static filter."""
        return float(max(-1 / np.linalg.eigvals(self.modes).real, default=0.0))

    def regressors(self, segment: Segment) -> Array:
        """Inputs, one, and the modes' responses to each input: (P, N)."""
        u, n = segment.inputs, len(self.modes)
        one = StateSpace(self.modes, self.drive[:, None], np.diag(self.scale), np.zeros((n, 1)), np.zeros(n))
        discrete = discretised(one, segment.period_s, self.hold)
        x = states(discrete.A, discrete.B[..., None] * u, equilibrium(one) * u[:, 0])
        read = np.tensordot(discrete.C, x, 1) + discrete.D[..., None] * u
        return np.concatenate([u, np.ones((1, u.shape[1])), *read.swapaxes(0, 1)])

    def samples(self, trace: Trace) -> tuple[Array, Array, Array]:
        """Regressors (P, N), the reference (N,) and the period in s (N,) of the samples that have a reference."""
        parts = []
        for segment in grids(trace, self.inputs):
            known = ~np.isnan(segment.outputs[0])
            period_s = np.full(np.count_nonzero(known), segment.period_s)
            parts.append((self.regressors(segment)[:, known], segment.outputs[0, known], period_s))
        raw, reference, weight_s = zip(*parts)
        return np.concatenate(raw, axis=1), np.concatenate(reference), np.concatenate(weight_s)

    def statistics(self, trace: Trace) -> tuple[NormalEquations, float]:
        """What ``trace`` says: the normal equations, a row a block, and the autocorrelation time of its noise in s.

        Raises :class:`Refused` where it says nothing.
        """
        raw, reference, weight_s = self.samples(trace)
        Z, r = self.weights.T @ raw, reference - self.origin @ raw
        if not np.isfinite(Z).all():
            raise refuse(trace.path, "", "the filter's responses are not finite", "look for error codes in the sensors")
        cut = np.array_split(np.arange(len(r)), BLOCKS)
        cut_up = (NormalEquations.of_samples(Z[:, index], r[index], weight_s[index]) for index in cut)
        blocks = NormalEquations.stacked(cut_up)
        # of the noise: what a unit's own weakly regularised least squares leave
        whole, scale = blocks.total(), _NOISE_DEGC2 * _CORRELATION_S
        own = np.linalg.solve(whole.H / scale + np.eye(len(Z)) / _WEAK_DEGC**2, whole.g / scale)
        return blocks, autocorrelation_time(r - own @ Z) * float(weight_s[0])

    def system(self, c: Array) -> StateSpace:
        """The filter at coordinates c: the transpose of its modes, driven by each input through that one's gains."""
        beta, m, n = self.origin + self.weights @ c, len(self.inputs), len(self.modes)
        B = self.scale[:, None] * beta[m + 1 :].reshape(m, n).T
        return StateSpace(
            self.modes.T.copy(), B, self.drive[None].copy(), beta[None, :m].copy(), beta[m : m + 1].copy()
        )

    @property
    def parameters(self) -> tuple[tuple[str, ...], Array, Array]:
        """Names of what a user can read, their values at the origin (k,), and how they follow the coordinates (k, p).

        The DC gain of each input, and the offset.
        """
        m = len(self.inputs)
        at_rest = self.scale * np.linalg.solve(-self.modes, self.drive)
        raw = np.eye(m + 1, len(self.origin))
        raw[:m, m + 1 :] = np.kron(np.eye(m), at_rest)
        names = (*(f"dc_gain_{each.rpartition('_')[0]}" for each in self.inputs), "offset_degC")
        return names, raw @ self.origin, raw @ self.weights


def grids(trace: Trace, inputs: Sequence[str]) -> list[Segment]:
    """The uniform stretches of a unit's log; raises :class:`Refused` where no sample has a reference."""
    if not np.isfinite(trace.reference).any():
        raise refuse(trace.path, f"column {REFERENCE}", "holds no value at all", "log a reference")
    found = segments(trace, inputs, (REFERENCE,), None, _BRIDGED_S)
    found = [each for each in found if not np.isnan(each.outputs).all()]
    if sum(int(np.count_nonzero(~np.isnan(each.outputs))) for each in found) < 2 * BLOCKS:
        raise refuse(trace.path, "", "fewer than ten samples have all sensors and a reference", "log longer")
    return found


def members(fit: Fit) -> dict[str, Fit]:
    """The linear systems of a fit by name: its main one, the secondary, and the fallbacks."""
    second = {} if fit.secondary is None else {SECONDARY: fit.secondary.fit}
    return {MAIN: fit, **second, **{WITHOUT.format(name): each for name, each in fit.fallbacks.items()}}


def map_members(fit: Fit, change: Callable[[Fit, str], Fit]) -> Fit:
    """``fit`` with each of its members changed, of which ``change`` gets the name, too."""
    second = fit.secondary and fit.secondary._replace(fit=change(fit.secondary.fit, SECONDARY))
    fallbacks = {name: change(each, WITHOUT.format(name)) for name, each in fit.fallbacks.items()}
    return replace(change(fit, MAIN), secondary=second, fallbacks=fallbacks)


def with_systems(fit: Fit, systems: Mapping[str, StateSpace]) -> Fit:
    """``fit`` with other systems in the places of its own."""

    def with_system(each: Fit, name: str) -> Fit:
        states = tuple(f"mode{k + 1}" for k in range(len(systems[name].A)))
        return replace(each, system=systems[name], states=states, error_variance=None)

    return map_members(fit, with_system)


def space_of(fit: Fit, traces: Sequence[Trace]) -> Space:
    """The coordinates about ``fit``, white over ``traces``, whose least squares are the origin.

    Raises :class:`Refused` for a fit that estimates something else than the ambient.
    """
    if fit.outputs != ("ambient",):
        what = ", ".join(fit.outputs)
        raise refuse(fit.circuit, "outputs", f"it predicts {what}", "take a circuit whose output is 'ambient'")
    n, m = len(fit.system.A), len(fit.inputs)
    modes, drive = schur(fit.system.A)[0] if n else np.zeros((0, 0)), np.ones(n)
    # one input of constant strength reaches every mode; each is scaled to what it is at rest
    rest = np.abs(np.linalg.solve(-modes, drive))
    size = m + 1 + n * m
    start = Space(fit.inputs, modes, drive, 1 / np.maximum(rest, 1e-9), fit.hold, np.zeros(size), np.eye(size))
    raw, reference, _ = zip(*map(start.samples, traces))
    X, target = np.concatenate(raw, axis=1).T, np.concatenate(reference)
    lengths = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-12)
    U, singular, Vt = np.linalg.svd(X / lengths / np.sqrt(len(X)), full_matrices=False)
    kept = singular > max(_LEAST_RMS_DEGC / np.linalg.norm(lengths), 1e-10 * singular[0])
    weights = (Vt[kept].T / singular[kept]) / lengths[:, None]
    origin = weights @ (U[:, kept].T @ target) / np.sqrt(len(X))
    return replace(start, origin=origin, weights=weights)
