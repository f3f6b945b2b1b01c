"""The diagnosis: the circuit is fitted, effects are selected one after the other, and the gain of each is measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from threadpoolctl import threadpool_limits

from ambient_model.faults import Fault, Refused
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.addition import with_values
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.causes import kind_of
from ambient_trainer.diagnosis.experiment import next_experiment
from ambient_trainer.diagnosis.extended_circuit import Extension, extended_circuit
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.gain import Blocks, differ
from ambient_trainer.diagnosis.lacking import diagnose_lacking
from ambient_trainer.diagnosis.misfit import misfit_of
from ambient_trainer.diagnosis.model import Effect
from ambient_trainer.diagnosis.record import Record, diagnosis_period_s
from ambient_trainer.diagnosis.result import UNKNOWN, Cause, Diagnosis, Gain, Ranked, Step
from ambient_trainer.diagnosis.selection import Selection, SelectionStep, Trial, known_good_model, select_effects
from ambient_trainer.diagnosis.training import TrainedCircuit, records_of, train_on_baselines
from ambient_trainer.diagnosis.view import View, conductances_to_ambient
from ambient_trainer.diagnosis.words import digits, window

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

FEWEST_SAMPLES = 100
_MOST_UNEXPLAINED = 0.5
"""Of a sensor's own standard deviation: a simulation that leaves more does not describe the data."""
_MOST_MISFIT, _MOST_OF_A_LARGE_MISFIT = 2.0, 8.0
"""In units of what known-good records leave: below the one the data are described, beyond the other they are not."""
_ROUNDING_DEGC = 0.051
"""Two instruments differ by more at some time; a column and its copy with one decimal do not."""


def diagnose(
    circuit: Circuit,
    traces: Sequence[Trace],
    baselines: Sequence[Trace] = (),
    progress: Progress | None = None,
    period_s: float | None = None,
) -> Diagnosis:
    """Name what a circuit lacks to describe traces, and measure what adding it gains.

    Parameters
    ----------
    circuit : Circuit
        It is read forward: ambient and drives in, the temperature of every sensor out.
    traces : sequence of Trace
        What is diagnosed, at least 100 samples each.
    baselines : sequence of Trace
        Known-good traces of the same device. With any, the circuit is fitted to them and held: the question is what
        has changed since. Without, it is fitted to ``traces`` themselves: the question is what it lacks.
    progress : callable, optional
        Called with a stage and how many of its parts are done.
    period_s : float, optional
        Of the grid; by default the finest that leaves at most 2000 samples of the longest trace, without
        ``baselines`` up to 5000 where the circuit's time constants are short.

    Returns
    -------
    Diagnosis
        Steps, each with its cause and its gain on held-out blocks of time, and the misfit that they explain.

    Raises
    ------
    Refused
        Names every fault of the data: too few samples, a column without values, a reference that copies a sensor.

    Notes
    -----
    Without ``baselines`` see :mod:`ambient_trainer.diagnosis.lacking`. With them, effects are selected forward. All
    candidates are screened by a regression of the whitened residual on what each would add to the sensors; the best are
    simulated, fitted together with the circuit's free parameters, and scored on blocks of time that their coefficients
    have not seen (5-fold). The score's penalty is Schwarz's (1978), p-values are corrected for the number of candidates
    and windows (Bonferroni).

    Examples
    --------
    >>> found = diagnose(load_circuit("phone"), [load_trace("day.csv")], [load_trace("good.csv")])  # doctest: +SKIP
    >>> str(found.verdict_cause)  # doctest: +SKIP
    'heat_source at flash by camera_on'
    """
    plain = forward(circuit)
    _check(plain, [*traces, *baselines])
    fitting = None if progress is None else lambda done, total, rmse: progress("fit", done, total)
    with threadpool_limits(1):
        if not baselines:
            return diagnose_lacking(circuit, traces, period_s, progress)
        period_s = period_s or diagnosis_period_s([*traces, *baselines])
        trained = train_on_baselines(plain, baselines, period_s, known_good_model, fitting)
        return diagnose_trained(trained, circuit, traces, [trace.path for trace in baselines], period_s, progress)


def diagnose_trained(
    trained: TrainedCircuit,
    circuit: Circuit,
    traces: Sequence[Trace],
    baselines: Sequence[str],
    period_s: float,
    progress: Progress | None = None,
) -> Diagnosis:
    """:func:`diagnose` with a circuit that was trained before, for many traces of one device."""
    own = [each for trace in traces for each in records_of(trained.model.plant.circuit, trace, period_s)]
    selection = select_effects(trained, own, progress)
    steps = _steps(selection) if _describes(selection, trained, own) else (_unknown(selection),)
    named = bool(steps) and steps[0].cause.name != UNKNOWN
    extension = extended_circuit(circuit, selection.final.model) if named else Extension(None, ())
    view = selection.plain.longest
    return Diagnosis(
        trace=", ".join(trace.path for trace in traces),
        circuit=circuit.name,
        baselines=tuple(baselines),
        time_s=view.record.time_s,
        signals={**view.signals, REFERENCE: view.ambient_degC},
        misfit=misfit_of(view),
        steps=steps,
        verdict=steps[0] if steps else None,
        ranking=_ranking(selection.steps[0]),
        next_experiment=next_experiment(selection, steps),
        extended=extension.circuit,
        candidates_tried=selection.steps[0].tried,
        notes=extension.left_out,
        fitted=with_values(circuit, trained.model.plant.values),
    )


def _check(circuit: Circuit, traces: Sequence[Trace]) -> None:
    faults = []
    for trace in traces:
        if len(trace.time_s) < FEWEST_SAMPLES:
            problem = f"{len(trace.time_s)} samples are too few for a diagnosis"
            faults.append(Fault(trace.path, problem, f"log at least {FEWEST_SAMPLES}"))
        faults.extend(_empty(circuit, trace))
        for name in circuit.inputs:
            faults.extend(_same_as_a_sensor(circuit, trace, name))
    if faults:
        raise Refused("diagnose", faults)


def _empty(circuit: Circuit, trace: Trace) -> list[Fault]:
    wanted = (*circuit.inputs, *(output.column for output in circuit.outputs))
    return [
        Fault(trace.path, f"{name} holds no value", "log it, or take a circuit without it")
        for name in wanted
        if np.isnan(trace.column(name)).all()
    ]


def _same_as_a_sensor(circuit: Circuit, trace: Trace, name: str) -> list[Fault]:
    if not name.endswith("_degC"):
        return []
    return [
        Fault(trace.path, f"{name} is {output.column}, value by value", "log what it stands for")
        for output in circuit.outputs
        if _alike(trace.column(output.column), trace.column(name))
    ]


def _alike(one: Array, other: Array) -> bool:
    apart = np.abs(one - other)
    return bool((apart[~np.isnan(apart)] <= _ROUNDING_DEGC).all()) and not np.isnan(apart).all()


def _steps(selection: Selection) -> tuple[Step, ...]:
    own = [effect for effect in selection.final.model.effects if not effect.known]
    every = zip(selection.steps, own, selection.views)
    return tuple(_step(step, effect, views, selection.final.longest) for step, effect, views in every)


def _step(step: SelectionStep, effect: Effect, views: Sequence[View], final: View) -> Step:
    """The step that selected ``effect``, with its numbers as they are in the ``final`` model."""
    assert step.selected is not None
    estimate, gain = effect.estimate(final), step.selected.gain
    magnitude = effect.candidate.magnitude(estimate)
    sentence = (
        f"{effect.candidate.cause}: {magnitude.meaning} {digits(magnitude.value)} {magnitude.unit}"
        f" ({digits(magnitude.ci95[0])} to {digits(magnitude.ci95[1])}), {window(effect.onset_s, effect.end_s)};"
        f" on held-out data {gain.rmse_before_degC:.2f} becomes {gain.rmse_after_degC:.2f} degC."
    )
    return Step(
        cause=effect.candidate.cause,
        onset_s=effect.onset_s,
        end_s=effect.end_s,
        magnitude=magnitude,
        confidence=_confidence(step, step.selected),
        gain=gain,
        indistinguishable_from=tuple(dict.fromkeys(rival.cause for rival in step.rivals)),
        sentence=sentence,
        parameters=effect.candidate.parameters(estimate),
        residual_degC=max(views, key=lambda each: each.record.samples).residual_degC,
    )


def _confidence(step: SelectionStep, selected: Trial) -> float:
    """The probability that neither chance nor the closest other cause does as well, by held-out errors of blocks."""
    others = [each for each in step.trials if each.cause != selected.cause]
    ahead = min((differ(each.blocks, selected.blocks) for each in others), default=np.inf)
    return float(norm.cdf(ahead) * (1.0 - selected.gain.p_value))


def _ranking(step: SelectionStep) -> tuple[Ranked, ...]:
    rivals = {id(each) for each in step.rivals}
    return tuple(
        Ranked(
            each.cause,
            each.effect.onset_s,
            each.effect.end_s,
            each.effect.magnitude(each.fitted.longest),
            each.gain,
            _remark(step, each, id(each) in rivals),
        )
        for each in step.trials
    )


def _remark(step: SelectionStep, trial: Trial, rival: bool) -> str:
    if trial is step.selected:
        return "taken"
    if trial.gain.ci95_degC[0] <= 0:
        return "no sure gain on held-out data"
    if step.selected is None:
        return "gains too little to matter"
    if rival:
        return "not distinguishable from the one taken"
    if trial.blocks.white.sum() < step.selected.blocks.white.sum():
        return "gains a little more, with more parameters"
    return "gains less on held-out data"


def _describes(selection: Selection, trained: TrainedCircuit, own: Sequence[Record]) -> bool:
    """Whether the model with all its steps describes the data, or most of the misfit: else no cause is named."""
    left = np.concatenate([each.residual_degC for each in selection.final.views], axis=1)
    read = np.concatenate([record.sensors for record in own], axis=1)
    variance = np.nanvar(read, axis=1)
    square = np.nanmean(left**2, axis=1)
    # all together, and the one that is worst off: a reading of noise drowns among others that are described
    for unexplained, whole in ((square.mean(), variance.mean()), (square.max(), variance[square.argmax()])):
        if unexplained > _MOST_UNEXPLAINED**2 * max(whole, 1e-12):
            return False
    if _confounded_with_ambient(selection):
        return False
    if not trained.normal:
        return True
    before, after = (
        Blocks.of(each, trained.noise).relative(trained.noise) for each in (selection.plain, selection.final)
    )
    return after < max(_MOST_MISFIT, min(_MOST_UNEXPLAINED * before, _MOST_OF_A_LARGE_MISFIT))


def _confounded_with_ambient(selection: Selection) -> bool:
    """Whether the first step is heat that an ambient which the reference holds constant would explain as well.

    Heat into a node and a warmer ambient of it are the same term of its equation.
    """
    cause = next((each.selected.cause for each in selection.steps if each.selected is not None), None)
    if cause is None or cause.signal is not None or not kind_of(cause).heats:
        return False
    plant = selection.final.model.plant
    joined = [name for name, each in zip(plant.nodes, conductances_to_ambient(plant)) if each > 0]
    return cause.location in joined and all(np.ptp(view.ambient_degC) == 0 for view in selection.plain.views)


def _unknown(selection: Selection) -> Step:
    before = Blocks.of(selection.plain, selection.noise).rmse_degC()
    sentence = f"The simulation is {before:.2f} degC off."
    gain = Gain(before, before, (0.0, 0.0), 1.0)
    return Step(Cause(UNKNOWN), None, None, None, 0.0, gain, (), sentence, {}, selection.plain.longest.residual_degC)
