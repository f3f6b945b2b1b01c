"""Bayes factors of the possible causes of a unit's deviation, under the variation of the population's circuits.

Typical units show what units of one make differ by: each has its own numbers of a forward circuit, and its own offset
and gain of every sensor, about a common mean (a nonlinear mixed-effects model, estimated by expectation-maximisation
with a Laplace approximation: Lindstrom and Bates, Biometrics 46(3), 1990). A unit that differs is fitted under that
prior with each cause in turn. What the evidence for one loses to the best is its Bayes factor (Kass and Raftery, J. Am.
Stat. Assoc. 90, 1995). So a conductance that scatters from unit to unit is no cause, and neither is what a sensor of
this make may be off by.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from threadpoolctl import threadpool_limits

from ambient_model.faults import refuse
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.diagnosis import NONE, UNKNOWN, KnownGood, forward
from ambient_trainer.diagnosis.diagnose import FEWEST_SAMPLES
from ambient_trainer.diagnosis.findings import cause_of
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.file import greybox_of
from ambient_trainer.diagnosis.greybox.mechanisms.sensor import Bias, Gain
from ambient_trainer.diagnosis.greybox.model import FREE_SD, Mechanism, Number
from ambient_trainer.diagnosis.greybox.regression import Fitted, Prior, fit
from ambient_trainer.diagnosis.greybox.screening import Screened, change_candidates, ends_within, screen
from ambient_trainer.diagnosis.greybox.stepwise import bare_fit
from ambient_trainer.diagnosis.greybox.trials import Trial, fit_candidates
from ambient_trainer.diagnosis.record import Record, diagnosis_period_s, records_of
from ambient_trainer.estimation.uncertainty import autocorrelation_time
from ambient_trainer.fleet.dataset import require_values

_COARSER = 2
"""Times the period of a diagnosis of its own: what lasts needs no finer one, and it halves the time."""
_BEGUN_WITH, _ROUNDS, _STEPS = 6, 6, 4
_PART_SD, _SENSOR_SD = 0.3, 1.0
"""Between units, before they are known: of a circuit's number, and of an offset in degC or a gain in hundredths."""
_COUNTS_AS, _FINEST_DEGC = 2.0, 1e-3
_AMOUNT_SD, _LOG_SD = {"sensor_gain": 20.0}, 1.5
"""Of what a cause may amount to: 5 K at its place, a fifth of what a sensor reads, or a factor of four and a half."""
_SETTLED_S = 600.0
"""A fit begins at the first readings, which a faulty sensor has wrong: what it leaves till then counts for no cause."""
_DOUBTED = 2.0
"""Evidence counts half: what a circuit leaves is no noise of one autocorrelation time. A gain that was wrong for 23
minutes was a bias with 0.94 where it counted whole.
"""
_LOGGED = 3.0
"""An offset is so many times as probable beforehand as a heat that has always been there and that nothing logs."""
_MUCH, _MOSTLY = 4.0, 0.1
"""What the best cause leaves is not described where it is so many times what typical units leave, and such a share of
what was left without."""
_PASSING = 20
"""Causes that begin or end within the log are fitted at so many places."""
_LAWS = ("convection_law", "latent_heat")
"""What holds for all units of a make, if for one."""
_RIVAL, _SUREST = 0.1, 0.98


class Typical(NamedTuple):
    """The circuit of typical units, their scatter as its prior, and the autocorrelation time of what they leave."""

    known: KnownGood
    correlation_s: float


class Outlier(NamedTuple):
    """A unit that does not fit the population: minus the decimal logarithm of how probable it is, and the cause.

    ``confidence`` is the cause's probability; ``rivals`` are those that are a tenth as probable at least.
    """

    unit: str
    improbability: float = np.nan
    cause: str | None = None
    location: str | None = None
    confidence: float | None = None
    rivals: str | None = None


def learn(circuit: Circuit, traces: Sequence[Trace]) -> Typical:
    """The forward circuit of typical units; raises :class:`Refused` where it cannot be simulated on them."""
    with threadpool_limits(1):
        plain = forward(circuit)
        usable = [_checked(plain, trace) for trace in traces]
        period_s = _COARSER * diagnosis_period_s(usable)
        records = [max(records_of(plain, trace, period_s), key=lambda each: each.samples) for trace in usable]
        begun = bare_fit(greybox_of(plain), records[:_BEGUN_WITH]).model
        # an offset and a gain of each sensor, which units differ by
        model = begun
        for each in (output.name for output in plain.outputs):
            model = model.with_mechanism(Bias((each,), (Number(f"bias_{each}", "degC", 0.0),)))
            model = model.with_mechanism(Gain((each,), (Number(f"gain_{each}", "1", 0.0, scale=0.01),)))
        before = np.full(len(model.numbers), _SENSOR_SD**2)
        before[: len(begun.numbers)] = _PART_SD**2
        units, mean, between = [model] * len(records), model.z(), np.diag(before)
        for _ in range(_ROUNDS):
            prior = Prior(mean, np.linalg.inv(between))
            fits = [fit(unit, [record], most=_STEPS, prior=prior) for unit, record in zip(units, records)]
            units = [unit if found is None else found.model for unit, found in zip(units, fits)]
            known = [each for each in fits if each is not None]
            left = [np.sqrt(np.nanmean(each.residual_degC(0) ** 2, axis=1)) for each in known]
            noise = np.maximum(np.median(left, axis=0), _FINEST_DEGC)
            weight = np.sqrt(np.mean(noise**2)) / noise
            records = [replace(each, weight=weight) for each in records]
            mean, between = _scatter(known, np.diag(before))
        rmse_degC = float(np.sqrt(np.mean(noise**2)))
        correlation_s = period_s * float(np.median([_autocorrelation(each) for each in known]))
        prior = Prior(mean, np.linalg.inv(between))
        return Typical(KnownGood(model.at(mean), prior, period_s, noise, rmse_degC), correlation_s)


def _checked(plain: Circuit, trace: Trace) -> Trace:
    """A trace with all that a forward circuit needs; raises :class:`Refused` for another one."""
    if (samples := len(trace.time_s)) < FEWEST_SAMPLES:
        hint = f"at least {FEWEST_SAMPLES} are needed: log longer"
        raise refuse(trace.path, "", f"{samples} samples are too few for a diagnosis", hint)
    return require_values(trace, [*plain.inputs, *(output.column for output in plain.outputs)])


def _scatter(fits: Sequence[Fitted], before: Array) -> tuple[Array, Array]:
    """Mean (p,) and covariance (p, p) of the units' numbers, each with what is not known of it."""
    Z = np.array([each.model.z() for each in fits])
    apart = Z - Z.mean(axis=0)
    square = apart.T @ apart + _COUNTS_AS * before
    for each in fits:
        noise = float(np.mean(each.residual**2)) * _autocorrelation(each)
        square += np.linalg.inv(each.slopes.T @ each.slopes / noise + each.prior.precision)
    return Z.mean(axis=0), square / (len(fits) + _COUNTS_AS)


def _autocorrelation(fitted: Fitted) -> float:
    """The autocorrelation time of what is left at the median sensor, in samples."""
    left = fitted.residual_degC(0)
    return float(np.median([autocorrelation_time(row[np.isfinite(row)]) for row in left if np.isfinite(row).any()]))


def name_cause(typical: Typical, trace: Trace, unit: str = "") -> Outlier:
    """What is odd about the unit of a trace: its most probable cause."""
    with threadpool_limits(1):
        known = typical.known
        bare = known.bare_fit(known.records([_checked(known.model.circuit, trace)]))
        screened = [each for each in screen(Context(bare), change_candidates) if _of_one_unit(each.mechanism)]
        trials = [each for each in fit_candidates(bare, _forms(screened), lambda *_: None) if not each.at_bounds]
    return _most_probable(unit, bare, trials, typical)


def _of_one_unit(mechanism: Mechanism) -> bool:
    """Whether it may have happened to one unit: one thing, at a place or to all that meets the ambient, and no law."""
    alone = len(mechanism.places) < 2 or mechanism.cause == "ambient_coupling"
    return alone and mechanism.cause not in _LAWS


def _forms(screened: Sequence[Screened]) -> list[Screened]:
    """Of candidates, best first, that of each cause at each place which lasts, and the first that do not."""
    best: dict[object, Screened] = {}
    for each in screened:
        mechanism = each.mechanism
        best.setdefault((mechanism.cause, mechanism.places, mechanism.permanent), each)
    passing = [each for each in best.values() if not each.mechanism.permanent]
    return [*(each for each in best.values() if each.mechanism.permanent), *passing[:_PASSING]]


def _most_probable(unit: str, bare: Fitted, trials: Sequence[Trial], typical: Typical) -> Outlier:
    """The cause with the greatest posterior probability, each place counting as much as any other beforehand.

    Where even the best leaves more than typical units do, evidence counts the less: what is left is no noise.
    """
    without, much = _evidence(bare, typical)
    found = [(_evidence(each.fitted, typical), each.mechanism) for each in trials]
    least = min([misfit for (_, misfit), _ in found], default=much)
    samples = bare.records[0].samples * typical.known.period_s / typical.correlation_s
    expected = len(bare.records[0].sensors) * samples / 2
    scores: dict[tuple[str, str | None], float] = {}
    for (evidence, _), mechanism in found:
        score = (evidence - without) / (_DOUBTED * max(1.0, least / expected))
        score -= sum(ends_within(mechanism)) * np.log(max(samples, 2.0))
        score -= np.log(_LOGGED) if mechanism.cause == "heat_source" and mechanism.driver is None else 0.0
        named = cause_of(mechanism, bare.model.circuit)
        key = named.name, named.place
        scores[key] = max(score, scores.get(key, -np.inf))
    scores[NONE, None] = float(np.log(max(len(scores), 1)))
    keys, values = list(scores), np.array(list(scores.values()))
    share = np.exp(values - values.max())
    share /= share.sum()
    order = np.argsort(-share, kind="stable")
    cause, place = keys[order[0]]
    if cause == NONE:
        return Outlier(unit, cause=NONE)
    if least > _MUCH * expected and least > _MOSTLY * much:
        return Outlier(unit, cause=UNKNOWN)
    rivals = "; ".join(" at ".join(filter(None, keys[k])) for k in order[1:] if share[k] > _RIVAL * share[order[0]])
    return Outlier(unit, np.nan, cause, place, min(float(share[order[0]]), _SUREST), rivals or None)


def _evidence(fitted: Fitted, typical: Typical) -> tuple[float, float]:
    """The logarithm of a fit's marginal likelihood by Laplace's approximation, and its misfit: half of chi-square."""
    settled = np.concatenate([_settled(record) for record in fitted.records])
    J, r = fitted.slopes[settled], fitted.residual[settled]
    noise = typical.known.rmse_degC**2 * typical.correlation_s / typical.known.period_s
    own = len(fitted.prior.z)
    added = fitted.model.numbers[own:]
    most = [_AMOUNT_SD.get(each.cause, 5.0) for each in fitted.model.mechanisms for _ in each.numbers][-len(added) :]
    sd = np.array([_LOG_SD if each.log else min(each.prior_sd, size) for each, size in zip(added, most)])
    amount = np.array([0.0 if each.log or each.prior_sd < FREE_SD else each.z for each in added])
    apart = np.concatenate([fitted.model.z()[:own] - fitted.prior.z, amount])
    precision = block_diag(fitted.prior.precision, np.diag(sd**-2.0))
    misfit = float(r @ r) / noise / 2
    widths = np.linalg.slogdet(J.T @ J / noise + precision)[1] - np.linalg.slogdet(precision)[1]
    return -misfit - float(apart @ precision @ apart + widths) / 2, misfit


def _settled(record: Record) -> NDArray[np.bool_]:
    """Which of a record's readings count."""
    after_s = min(_SETTLED_S, (record.time_s[-1] - record.time_s[0]) / 10)
    return np.asarray(record.time_s >= record.time_s[0] + after_s)[record.valid % record.samples]
