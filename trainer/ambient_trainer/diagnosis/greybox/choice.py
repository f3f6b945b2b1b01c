"""Selection of a trial by its gain on held-out data, physical causes before sensor faults."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import COARSE
from ambient_trainer.diagnosis.greybox.model import Mechanism
from ambient_trainer.diagnosis.greybox.regression import Fitted
from ambient_trainer.diagnosis.greybox.trials import PENALTY, Trial, complexity, penalised
from ambient_trainer.diagnosis.record import Record

LEAST_GAIN = 0.05
"""Minimum gain of a step, in the logarithm of the held-out error: a smaller one is overfitting."""
_SENSOR_FAULT_MARGIN, _SENSOR_FAULT_MARGIN_KNOWN_GOOD = 1.3, 1.1
"""See :func:`fault_margin`; the second with known-good records."""
_MAX_LEFT, _MAX_LEFT_CHANGED = 0.5, 0.7
"""Maximum share of the error that a sensor fault may leave at its sensor; the second with known-good records."""
_ONE_SIDED_95 = 1.645
_PERMANENT_MARGIN, _PERMANENT_MARGIN_KNOWN_GOOD, ENDOGENOUS_PENALTY, MIN_CORRELATION = 1.3, 1.05, 1.5, 0.6
_MIN_COLLINEARITY = 0.9
"""Correlation from which drivers are not distinguishable: two pyranometers in one place, wind and gusts."""
_MAX_FOLD_ERROR_RATIO = 1.5
"""Maximum ratio of fold errors with a window to those without it: chosen on a measured heater block."""
MAX_UNEXPLAINED_BY_WINDOW, _STRETCHES = 0.38, 60
"""Maximum share of the low-frequency error that a window may leave: the best step leaves 0.58 of a random walk, less
than this of one in twenty. Of sixteen windows found in measured logs those below it were mostly right, others not."""
_STEP_MEAN_SAMPLES, _STEP_SEARCH_SAMPLES, _MIN_STEP_FRAC = 3, 8, 0.5
"""Samples averaged on each side of a step, samples searched around a window's end, and least share of the offset."""
_SWITCH_FRAC, _SWITCH_SAMPLES, _MAX_CHANCE_P, _MAX_DELAY_FRAC = 0.3, 3, 0.05, 0.1
"""Share of a column's range that counts as switching; samples around a window's end in which it has to switch; maximum
probability of that by chance; and the maximum delay of a window after a switch, as a share of the record over the
number of switches: for two late heaters in measured logs 5 and 6 % after the only one."""


@dataclass(frozen=True)
class SelectionStep:
    """A step of the selection: the model before it, the trial that was chosen, and all trials, best first."""

    before: Fitted
    chosen: Trial | None
    trials: tuple[Trial, ...]
    tried: int
    """Candidates that were screened."""

    @property
    def gain(self) -> float:
        """Of the held-out error's logarithm; 0 where nothing was chosen."""
        return 0.0 if self.chosen is None else float(np.log(self.before.held_out_rmse_degC / self.chosen.rmse_degC))


@dataclass(frozen=True)
class Limits:
    """Held-out errors: below ``floor_degC``, which a black box leaves, only large gains count; ``least_degC`` is what
    every step has to gain."""

    floor_degC: float = 0.0
    least_degC: float = 0.0


UNLIMITED = Limits()


def choose(before: Fitted, trials: Sequence[Trial], least_degC: float) -> Trial | None:
    """The trial with the least penalised error; None where none gains enough. Physical causes precede sensor faults.

    A fault that is visible in the readings alone, a stuck sensor, comes first.
    """
    ordered = sorted((each for each in trials if not each.at_bounds), key=penalised)
    for each in ordered:
        if each.mechanism.visible_in_readings and _explains_its_sensor(before, each, _MAX_LEFT):
            return each
    passing = [each for each in ordered if gains(before, each, least_degC) and each.identified and _has_steps(each)]
    physical = [each for each in passing if not each.mechanism.instrument]
    # what a logged driver explains may lie within one fold: then short stretches alone show it
    driven = [each for each in ordered if not each.mechanism.instrument and each.mechanism.driver is not None]
    driven = [each for each in driven if _halves_error(before, each)]
    sound = [*physical, *driven]
    # what acts for a while and is no finding says nothing against the reference
    permanent = [each for each in trials if not each.mechanism.instrument and each.permanent]
    much, enough = fault_margin(before.records), _MAX_LEFT_CHANGED if before.records[0].known_good else _MAX_LEFT
    faults = [each for each in passing if each.mechanism.instrument and not _is_switched(each)]
    best = _best_by_sensor(faults)
    for each in best:
        # a late reference looks like nothing else: there it is enough to do better than all physics, sound or not
        late = each.mechanism.of_reference
        rivals = [*sound, *permanent] if late else sound
        rivalled = any(other.rmse_degC <= each.rmse_degC * much for other in rivals)
        if not rivalled and (late or _explains_its_sensor(before, each, enough)):
            return each
    for each in filter(_is_offset_step, faults):
        # other faults are rivals, too: a drift of the sensor may come as near, but leaves the step in the readings
        near = (other for other in (*sound, *best) if other is not each and other.rmse_degC <= each.rmse_degC * much)
        if all(_has_steps_at_ends(each, other.fitted) for other in near):
            return each
    # another temperature that is logged may answer to the same cause: it has to explain much more
    given = [each for each in physical if not each.mechanism.endogenous]
    otherwise_degC = given[0].rmse_degC if given else before.held_out_rmse_degC
    if physical and otherwise_degC < ENDOGENOUS_PENALTY * physical[0].rmse_degC:
        physical = given
    if not physical:
        return None
    first = _prefer_permanent(_simplest(physical, least_degC), physical, driven)
    if first.mechanism.cause != "sensor_bias":
        return first
    # an offset of the reference does to all nodes what the sun, or a heater of the log, does on the average
    logged = (each for each in physical if each.permanent and each.mechanism.driver is not None)
    return next((each for each in logged if each.rmse_degC < ENDOGENOUS_PENALTY * first.rmse_degC), first)


def fault_margin(records: Sequence[Record]) -> float:
    """Ratio by which a physical cause's error has to exceed a sensor fault's error for the fault to be chosen.

    Known-good records show bodies, paths and losses, for which a fault may stand elsewhere. Beside them physics that
    was taken for a fault often left less than 1.3 times as much; logs without one are blamed no more often for it.
    """
    return _SENSOR_FAULT_MARGIN_KNOWN_GOOD if records[0].known_good else _SENSOR_FAULT_MARGIN


def _best_by_sensor(instruments: Sequence[Trial]) -> list[Trial]:
    """For each set of sensors the fault with the least penalised error there: it changes no other sensor."""
    best: dict[tuple[str, ...], Trial] = {}
    for each in instruments:
        places = each.mechanism.places
        best[places] = min(best.get(places, each), each, key=_score_at_its_sensor)
    return list(best.values())


def _score_at_its_sensor(trial: Trial) -> float:
    return float(np.log(_sensor_rmse_degC(trial.fitted, trial))) + PENALTY * complexity(trial.mechanism)


def _simplest(ordered: Sequence[Trial], least_degC: float) -> Trial:
    """The first trial whose extra parameters gain enough compared with the same law with fewer of them."""
    first = ordered[0]
    for each in ordered[1:]:
        same = _is_same_law(each.mechanism, first.mechanism) and each.permanent == first.permanent
        if same and len(each.mechanism.numbers) < len(first.mechanism.numbers):
            enough = penalised(first) < penalised(each) - LEAST_GAIN and first.rmse_degC < each.rmse_degC - least_degC
            return first if enough else _simplest(ordered[1:], least_degC)
    return first


def _is_same_law(one: Mechanism, other: Mechanism) -> bool:
    """Whether both have one form: a reference offset acts as constant heat at each node in proportion to its loss."""
    constant_heat = other.cause == "heat_source" and other.driver is None
    return one.key == other.key or (one.cause == "sensor_bias" and constant_heat)


def _prefer_permanent(first: Trial, ordered: Sequence[Trial], driven: Sequence[Trial]) -> Trial:
    """The first trial, unless it is temporary and a permanent one fits nearly as well on short stretches, or one of
    ``driven`` acted at that time: then the best of those and of the permanent ones."""
    if first.permanent:
        return first
    permanent = [each for each in ordered if each.permanent]
    if logged := [each for each in driven if _coincides_with_driver(first, each)]:
        return min((*logged, *permanent), key=_score_by_folds_and_stretches)
    error = float(np.sqrt(first.fitted.held_out_stretches.sum()))
    # what has changed since known-good records mostly did so while this one was logged
    most = (_PERMANENT_MARGIN_KNOWN_GOOD if first.fitted.records[0].known_good else _PERMANENT_MARGIN) * error
    return next((each for each in permanent if np.sqrt(each.fitted.held_out_stretches.sum()) < most), first)


def _halves_error(before: Fitted, trial: Trial) -> bool:
    """Whether a trial leaves less than half of the error of folds, or of short stretches."""
    by_stretches = trial.fitted.held_out_stretches.sum() < _MAX_LEFT**2 * before.held_out_stretches.sum()
    return bool(by_stretches or trial.rmse_degC < _MAX_LEFT * before.held_out_rmse_degC)


def _score_by_folds_and_stretches(trial: Trial) -> float:
    """Score by the errors on folds and on short stretches: a driver that moved once is not predicted by any fold."""
    by_stretches = float(np.log(trial.fitted.held_out_stretches.sum())) / 2 + PENALTY * complexity(trial.mechanism)
    return penalised(trial) + by_stretches


def _coincides_with_driver(window: Trial, logged: Trial) -> bool:
    """Whether a window without a driver coincides with a logged driver of the same cause at the same places."""
    if (window.mechanism.cause, window.mechanism.places) != (logged.mechanism.cause, logged.mechanism.places):
        return False
    return coincides_with(window.mechanism, logged.mechanism, window.fitted.records)


def coincides_with(window: Mechanism, logged: Mechanism, records: Sequence[Record]) -> bool:
    """Whether a window coincides with a logged driver, or begins soon after the driver is switched on, which it is too
    rarely for chance."""
    close = correlation(window, logged, records) > MIN_CORRELATION
    return close or any(_follows_switch(window, logged, each) for each in records)


def _follows_switch(window: Mechanism, logged: Mechanism, record: Record) -> bool:
    driver, onset_s = logged.driver, window.onset_s
    # what acts late was switched on before
    row = record.signals[driver.columns[0]] if driver is not None and driver.late else logged.weight(record)
    switched_s = record.time_s[:-1][np.diff(row) > max(_SWITCH_FRAC * float(np.ptp(row)), 1e-300)]
    if onset_s is None or not len(switched_s) or onset_s < switched_s[0]:
        return False
    since_s = onset_s - switched_s[switched_s <= onset_s][-1]
    return bool(len(switched_s) * since_s < _MAX_DELAY_FRAC * record.samples * record.period_s)


def correlation(one: Mechanism, other: Mechanism, records: Sequence[Record]) -> float:
    """Correlation of the weights of two mechanisms over time; 0 where either is constant."""
    rows = np.array([np.concatenate([each.weight(record) for record in records]) for each in (one, other)])
    return float(np.corrcoef(rows)[0, 1]) if np.ptp(rows, axis=1).all() else 0.0


def collinear(one: Mechanism, other: Mechanism, records: Sequence[Record]) -> bool:
    """Whether the logged drivers of two mechanisms are collinear."""
    return one.key[2] == other.key[2] or correlation(one, other, records) > _MIN_COLLINEARITY


def _has_steps(trial: Trial) -> bool:
    """Whether the readings step where a step-like offset begins and ends: heat acts gradually."""
    return not trial.mechanism.step_like or _has_steps_at_ends(trial, trial.fitted)


def leaves_offset_steps(fault: Trial, other: Trial) -> bool:
    """Whether the readings step at the ends of a sensor's offset, and still do in another trial's residual."""
    return _is_offset_step(fault) and _has_steps_at_ends(fault, other.fitted)


def _is_offset_step(trial: Trial) -> bool:
    """Whether it is an offset of one known-good sensor that begins or ends in the records with a step in readings."""
    mechanism = trial.mechanism
    if mechanism.cause != "sensor_bias" or len(mechanism.places) != 1 or not trial.fitted.records[0].known_good:
        return False
    return bool(_offset_ends(mechanism, trial.fitted.records)) and _has_steps_at_ends(trial, trial.fitted)


def _has_steps_at_ends(trial: Trial, fitted: Fitted) -> bool:
    """Whether the residual of a model steps where an offset begins and ends."""
    mechanism = trial.mechanism
    sensor = [output.name for output in fitted.model.circuit.outputs].index(mechanism.places[0])
    for index, record, at_s, size in _offset_ends(mechanism, fitted.records):
        left = fitted.residual_degC(index)[sensor]
        if fitted is trial.fitted:
            left = left + mechanism.numbers[0].value * mechanism.weight(record)
        edge = int(np.searchsorted(record.time_s, at_s))
        jumps = [_step_size(left, each) for each in range(edge - _STEP_SEARCH_SAMPLES, edge + _STEP_SEARCH_SAMPLES + 1)]
        if max(np.sign(size) * np.array(jumps)) < _MIN_STEP_FRAC * abs(size):
            return False
    return True


def _offset_ends(mechanism: Mechanism, records: Sequence[Record]) -> list[tuple[int, Record, float, float]]:
    """Ends of an offset within records: the record's index, the record, the time, and the size of the step."""
    amount = mechanism.numbers[0].value
    return [
        (index, record, at_s, size)
        for index, record in enumerate(records)
        for at_s, size in ((mechanism.onset_s, amount), (mechanism.end_s, -amount))
        if at_s is not None and record.time_s[0] < at_s < record.time_s[-1]
    ]


def _is_switched(trial: Trial) -> bool:
    """Whether a logged signal is switched where a sensor's offset begins and ends: faults do not coincide with that."""
    mechanism = trial.mechanism
    times = [at_s for at_s in (mechanism.onset_s, mechanism.end_s) if at_s is not None]
    for record in trial.fitted.records if mechanism.step_like else ():
        edges = np.searchsorted(record.time_s, [each for each in times if record.time_s[0] < each < record.time_s[-1]])
        for row in (row for name, row in record.signals.items() if not name.endswith("_degC") and len(edges)):
            jumps = np.abs(np.diff(row, prepend=row[0])) > max(_SWITCH_FRAC * float(np.ptp(row)), 1e-300)
            near = np.convolve(jumps, np.ones(2 * _SWITCH_SAMPLES + 1), "same") > 0.5
            if near[edges].all() and near.mean() ** len(edges) < _MAX_CHANCE_P:
                return True
    return False


def _step_size(row: Array, at: int) -> float:
    """Size of the step at ``at``: mean of the samples after it minus that before it; 0 where there are too few."""
    before, after = row[max(at - _STEP_MEAN_SAMPLES, 0) : max(at, 0)], row[at + 1 : at + 1 + _STEP_MEAN_SAMPLES]
    known = np.isfinite(before).any() and np.isfinite(after).any()
    return float(np.nanmean(after) - np.nanmean(before)) if known else 0.0


def _explains_its_sensor(before: Fitted, trial: Trial, share: float) -> bool:
    """Whether a trial leaves less than a share of the error at the sensor whose fault it is."""
    return _sensor_rmse_degC(trial.fitted, trial) < share * _sensor_rmse_degC(before, trial)


def _sensor_rmse_degC(fitted: Fitted, trial: Trial) -> float:
    """In-sample error at the sensor whose fault a trial is; at all sensors for the reference."""
    sensors = [output.name for output in fitted.model.circuit.outputs]
    blamed = [sensors.index(each) for each in (sensors if trial.mechanism.of_reference else trial.mechanism.places)]
    left = np.concatenate([fitted.residual_degC(index)[blamed] for index in range(len(fitted.records))], axis=1)
    return float(np.sqrt(np.nanmean(left**2)))


def gains(before: Fitted, after: Trial, least_degC: float) -> bool:
    """Whether a trial's gain on held-out folds is large enough and significant."""
    if penalised(after) > np.log(before.held_out_rmse_degC) - LEAST_GAIN:
        return False
    if before.held_out_rmse_degC - after.rmse_degC < least_degC:
        return False
    # of a window that is left out whole nothing is known, but the rest has to stand as it did
    if not after.permanent and after.fitted.held_out_rmse_degC > _MAX_FOLD_ERROR_RATIO * before.held_out_rmse_degC:
        return False
    if unexplained_by_window(before, after) > MAX_UNEXPLAINED_BY_WINDOW or _is_quantisation(after):
        return False
    by_stretches = is_significant(before.held_out_stretches - after.fitted.held_out_stretches)
    # what acts all the time may have shown itself in one fold only
    return by_stretches or (after.permanent and is_significant(before.held_out - after.fitted.held_out))


def _is_quantisation(trial: Trial) -> bool:
    """Whether a window may be due to quantisation: a sensor at its places reads only a few levels."""
    if trial.permanent or trial.mechanism.driver is not None:
        return False
    read = np.concatenate([record.sensors for record in trial.fitted.records], axis=1)
    places = set(trial.mechanism.places)
    there = [bool(places & {output.name, *(output.states or ())}) for output in trial.fitted.model.circuit.outputs]
    return any(len(np.unique(row[np.isfinite(row)])) < COARSE for row in read[there])


def unexplained_by_window(before: Fitted, after: Trial) -> float:
    """What is left, as a share of what was, at the sensor where a window that nothing logged drives gains most; 0 for
    all others, and where known-good records show how readings wander.

    Readings that drift at random always fit two levels better than one: see ``MAX_UNEXPLAINED_BY_WINDOW``.
    """
    mechanism = after.mechanism
    if mechanism.permanent or mechanism.driver is not None or mechanism.step_like or before.records[0].known_good:
        return 0.0
    was, left = (
        np.sum([_low_frequency_squares(fitted, index) for index in range(len(before.records))], axis=0)
        for fitted in (before, after.fitted)
    )
    most = int(np.argmax(was - left))
    return float(np.sqrt(left[most] / max(was[most], 1e-300)))


def _low_frequency_squares(fitted: Fitted, index: int) -> Array:
    """Sum of squares of each sensor's residual averaged over stretches of a record (s,)."""
    left = fitted.residual_degC(index)
    kept = np.array_split(left, min(_STRETCHES, left.shape[1]), axis=1)
    means = [np.nansum(each, axis=1) / np.maximum(np.isfinite(each).sum(axis=1), 1) for each in kept]
    return np.asarray(np.square(means).sum(axis=0) * left.shape[1])


def is_significant(apart: Array) -> bool:
    """Whether the mean gain of the folds is significantly positive, or most of them gain."""
    scatter = float(np.std(apart, ddof=1) / np.sqrt(len(apart)))
    return bool(apart.mean() > _ONE_SIDED_95 * scatter or (apart > 0).mean() >= 0.75)
