"""A diagnosis as the terminal, the page and a machine get it: the same numbers and words, put once."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from ambient_trainer.diagnosis.causes import noun
from ambient_trainer.diagnosis.residual_tests.autoregression import autoregression_of
from ambient_trainer.diagnosis.residual_tests.grid import Grid
from ambient_trainer.diagnosis.residual_tests.whiteness import autocorrelation_time
from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Array, Cause, Diagnosis, Gain, Magnitude, Step, Tested
from ambient_trainer.diagnosis.words import chance, duration, figures, window
from ambient_trainer.report.table import Table, for_terminal

SHOWN_RANKED = 8
_OF_WHITENESS = ("whiteness", "periodogram", "memory")


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one plain sentence."""
    step = diagnosis.verdict
    tried = f"{diagnosis.candidates_tried:,} candidates tried, each a cause at a place from some moment on,"
    if step is None:
        return (
            f"Nothing is missing: of the {tried} none makes {diagnosis.circuit} predict data it was not fitted to "
            "surely better, and by enough to matter."
        )
    if step.cause.name == UNKNOWN:
        return f"Something is missing that none of the {tried} explains. {step.sentence}"
    gain = _gain_in_words(step.gain)
    lasted = window(step.onset_s, step.end_s)
    size = ""
    if step.magnitude is not None:
        size = ", ".join(["", size_in_words(step.magnitude), *filter(None, [step.magnitude.qualifier])])
    others = len(diagnosis.steps) - 1
    more = "" if not others else f" {'One more effect' if others == 1 else f'{others} more effects'} found after it."
    words = noun(step.cause)
    return f"{words[0].upper()}{words[1:]}, {lasted}{size}: {gain}.{more}"


def size_in_words(magnitude: Magnitude) -> str:
    """``0.8 W (0.7 to 0.9 W)``."""
    low, high = magnitude.ci95
    unit = "" if magnitude.unit in ("", "1") else f" {magnitude.unit}"
    return f"{figures(magnitude.value)}{unit} ({figures(low)} to {figures(high)}{unit})"


def steps_table(diagnosis: Diagnosis) -> Table:
    """One row a step."""
    rows = tuple(
        (
            f"{number}. {step.cause}",
            window(step.onset_s, step.end_s),
            "-" if step.magnitude is None else size_in_words(step.magnitude),
            *_gain_cells(step.gain),
            f"{100 * step.confidence:.1f} %",
        )
        for number, step in enumerate(diagnosis.explained, start=1)
    )
    caption = (
        "Held-out: the simulation's RMSE over all sensors in degC, on blocks of time that it was not fitted to, "
        "without and with the cause; the interval (95 %) is of their difference. p is corrected for the "
        f"{diagnosis.candidates_tried:,} candidates tried."
    )
    columns = ("cause", "when", "magnitude (95 %)", "held-out RMSE", "gain (95 %)", "p", "confidence")
    return Table(caption, columns, rows, labels=2)


def ranking_table(diagnosis: Diagnosis, most: int = SHOWN_RANKED) -> Table:
    """The best candidates for the first step, and why each was not taken."""
    shown = diagnosis.ranking[:most]
    rows = tuple(
        (
            str(each.cause),
            each.remark or "-",
            window(each.onset_s, each.end_s),
            "-" if each.magnitude is None else size_in_words(each.magnitude),
            *_gain_cells(each.gain),
        )
        for each in shown
    )
    caption = f"The best {len(shown)} of {diagnosis.candidates_tried:,} candidates for the first effect; RMSE in degC."
    columns = ("candidate", "remark", "when", "magnitude (95 %)", "held-out RMSE", "gain (95 %)", "p")
    return Table(caption, columns, rows, labels=3)


def misfit_table(tests: Sequence[Tested]) -> Table:
    """One row a test, those that failed first."""
    ordered = sorted(tests, key=lambda each: not each.significant)
    rows = tuple(
        (
            each.name,
            each.subject,
            each.sentence,
            figures(each.statistic),
            figures(each.threshold),
            "yes" if each.significant else "no",
        )
        for each in ordered
    )
    caption = (
        "Thresholds: for whiteness and periodogram the textbook's; all others but memory are calibrated on simulated "
        "residuals of the same memory, so that without any effect one report in 20 has any of them beyond chance."
    )
    return Table(
        caption, ("test", "subject", "what it says", "statistic", "threshold", "beyond chance"), rows, labels=3
    )


def residuals_table(diagnosis: Diagnosis) -> Table:
    """One row a sensor: what the circuit as given leaves, and, where there are steps, what it does with them all."""
    last = [step.residual_degC for step in diagnosis.explained[-1:]]
    rows = []
    for number, (sensor, before) in enumerate(_residuals(diagnosis)):
        cells = [_degrees(_rmse(each)) for each in (before, *(left[number] for left in last))]
        rows.append((sensor, *cells, _degrees(_std(before)), _remembered(_memory_s(diagnosis.time_s, before))))
    caption = (
        "In degC, over the whole trace. Autocorrelation time: until the residual's correlation with itself is 1/e."
    )
    columns = ("sensor", "RMSE", *["RMSE with every step"] * len(last), "std", "memory")
    return Table(caption, columns, tuple(rows))


def remarks(diagnosis: Diagnosis) -> list[str]:
    """What has to be said besides: what cannot be told apart, and what to do next."""
    said = [
        f"{step.cause} cannot be told from {', '.join(map(str, step.indistinguishable_from))} by these data."
        for step in diagnosis.steps
        if step.indistinguishable_from
    ]
    if diagnosis.next_experiment:
        said.append(f"Next experiment: {diagnosis.next_experiment}")
    return said


def show(console: Console, diagnosis: Diagnosis) -> None:
    """The terminal's view."""
    console.print(Text(f"{os.path.basename(diagnosis.trace)}, {diagnosis.circuit}", style="bold"), soft_wrap=True)
    console.print(
        Text(headline(diagnosis), style="bold green" if diagnosis.verdict is None else "bold"), soft_wrap=True
    )
    if diagnosis.explained:
        console.print(for_terminal(steps_table(diagnosis)))
    if diagnosis.ranking:
        console.print(for_terminal(ranking_table(diagnosis)))
    console.print(for_terminal(residuals_table(diagnosis)))
    beyond = [each for each in diagnosis.misfit.tests if each.significant]
    console.print(Text(f"{len(beyond)} of {len(diagnosis.misfit.tests)} tests of the residual are beyond chance."))
    # every misfit leaves a residual that is not white: what it goes along with tells more
    told = sorted(beyond, key=lambda each: each.name in _OF_WHITENESS)
    for test in told[:SHOWN_RANKED]:
        console.print(Text(f"  {test.name}: {test.sentence}"), soft_wrap=True)
    if len(told) > SHOWN_RANKED:
        console.print(Text(f"  and {len(told) - SHOWN_RANKED} more: --report or --json shows them all."))
    for remark in (*remarks(diagnosis), *diagnosis.notes):
        console.print(Text(remark), soft_wrap=True)


def as_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of ``diagnose --json``; what is no number is null."""
    steps = [_step_data(step) for step in diagnosis.steps]
    return {
        "trace": diagnosis.trace,
        "circuit": diagnosis.circuit,
        "baselines": list(diagnosis.baselines),
        "steps": steps,
        "verdict": _nothing(diagnosis) if diagnosis.verdict is None else _step_data(diagnosis.verdict),
        "ranking": [
            {
                **_cause_data(each.cause),
                "onset_s": _number(each.onset_s),
                "end_s": _number(each.end_s),
                "magnitude": _magnitude_data(each.magnitude),
                "gain": _gain_data(each.gain),
                "remark": each.remark,
            }
            for each in diagnosis.ranking
        ],
        "residuals": {
            "sensors": {
                sensor: {
                    "rmse_degC": _number(_rmse(values)),
                    "std_degC": _number(_std(values)),
                    "memory_s": _number(_memory_s(diagnosis.time_s, values)),
                }
                for sensor, values in _residuals(diagnosis)
            },
            "heat_unit": diagnosis.misfit.heat_unit,
            "tests": [_test_data(each) for each in diagnosis.misfit.tests],
        },
        "next_experiment": diagnosis.next_experiment,
        "candidates_tried": diagnosis.candidates_tried,
        "notes": list(diagnosis.notes),
    }


def _step_data(step: Step) -> dict[str, Any]:
    return {
        **_cause_data(step.cause),
        "onset_s": _number(step.onset_s),
        "end_s": _number(step.end_s),
        "magnitude": _magnitude_data(step.magnitude),
        "confidence": _number(step.confidence),
        "gain": _gain_data(step.gain),
        "indistinguishable_from": [_cause_data(each) for each in step.indistinguishable_from],
        "sentence": step.sentence,
        "parameters": {
            name: {"value": _number(value), "unit": unit} for name, (value, unit) in step.parameters.items()
        },
    }


def _nothing(diagnosis: Diagnosis) -> dict[str, Any]:
    """The verdict where nothing is missing, with the keys that every step has."""
    return {
        **_cause_data(Cause(NONE)),
        "onset_s": None,
        "end_s": None,
        "magnitude": None,
        "confidence": None,
        "gain": None,
        "indistinguishable_from": [],
        "sentence": headline(diagnosis),
        "parameters": {},
    }


def _cause_data(cause: Cause) -> dict[str, Any]:
    return {"cause": cause.name, "location": cause.location, "signal": cause.signal}


def _magnitude_data(magnitude: Magnitude | None) -> dict[str, Any] | None:
    if magnitude is None:
        return None
    return {
        "value": _number(magnitude.value),
        "unit": magnitude.unit,
        "meaning": magnitude.meaning,
        "ci95": [_number(each) for each in magnitude.ci95],
    }


def _gain_data(gain: Gain) -> dict[str, Any]:
    return {
        "rmse_before_degC": _number(gain.rmse_before_degC),
        "rmse_after_degC": _number(gain.rmse_after_degC),
        "ci95_degC": [_number(each) for each in gain.ci95_degC],
        "p_value": _number(gain.p_value),
        "held_out": True,
    }


def _test_data(test: Tested) -> dict[str, Any]:
    return {
        "name": test.name,
        "subject": test.subject,
        "statistic": _number(test.statistic),
        "threshold": _number(test.threshold),
        "significant": bool(test.significant),
        "sentence": test.sentence,
    }


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _gain_in_words(gain: Gain) -> str:
    low, high = gain.ci95_degC
    return (
        f"with it, the error on held-out data falls from {_degrees(gain.rmse_before_degC)} to "
        f"{_degrees(gain.rmse_after_degC)} degC (gain {_degrees(low)} to {_degrees(high)} degC, {chance(gain.p_value)})"
    )


def _gain_cells(gain: Gain) -> tuple[str, str, str]:
    low, high = gain.ci95_degC
    return (
        f"{_degrees(gain.rmse_before_degC)} → {_degrees(gain.rmse_after_degC)}",
        f"{_degrees(low)} to {_degrees(high)}",
        chance(gain.p_value).removeprefix("p ").removeprefix("= "),
    )


def _degrees(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "-"


def _remembered(lag_s: float) -> str:
    return duration(lag_s) if math.isfinite(lag_s) else "-"


def _residuals(diagnosis: Diagnosis) -> list[tuple[str, Array]]:
    return list(zip(diagnosis.misfit.sensors, diagnosis.misfit.residual_degC))


def _rmse(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if len(known) else math.nan


def _std(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.std()) if len(known) else math.nan


def _memory_s(time_s: Array, values: Array) -> float:
    grid = Grid.over(time_s)
    series = grid.means(values)
    return autocorrelation_time(series, "", grid.step_s).statistic if autoregression_of(series) else math.nan
