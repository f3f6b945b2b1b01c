"""The report of a diagnosis: verdict, steps, candidates and residual tests, the same for terminal, page and machine."""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ambient_trainer.diagnosis import figures
from ambient_trainer.diagnosis.greybox.file import kinds
from ambient_trainer.diagnosis.residual_tests import correlation_s
from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Array, Cause, Diagnosis, Magnitude, Ranked, Step, Tested
from ambient_trainer.report import Block, Facts, Figure, Finding, Report, Section, Status, Table
from ambient_trainer.report.files import finite
from ambient_trainer.report.words import chance, clock, digits, duration, window

SHOWN_RANKED = 8
_SMALL_P = 0.05
"""A larger one is left to the table: over few blocks no test finds it smaller, whatever the gain is."""
_OF_WHITENESS = ("whiteness", "periodogram", "memory")


def report_of(diagnosis: Diagnosis) -> Report:
    """The report of a diagnosis; its ``data`` are the content of ``diagnose --json``."""
    status: Status = "result" if diagnosis.explained else "plain"
    verdict = Finding(headline(diagnosis), status, diagnosis.verdict_cause.name)
    lead: list[Block] = [verdict, *map(Finding, diagnosis.notes), _facts(diagnosis)]
    candidates = Section("Candidates for the first effect", [ranking_table(diagnosis)]) if diagnosis.ranking else None
    sections = [_causes(diagnosis), *_plots(diagnosis), candidates, _tests(diagnosis), _method(diagnosis)]
    subject = f"Diagnosis of {os.path.basename(diagnosis.trace)}, {diagnosis.circuit}"
    return Report(_title(diagnosis), lead, [each for each in sections if each], as_data(diagnosis), subject)


def _title(diagnosis: Diagnosis) -> str:
    step, subject = diagnosis.verdict, f"{mostly(diagnosis)}{os.path.basename(diagnosis.trace)}, {diagnosis.circuit}"
    if step is None:
        return f"{subject}: nothing is missing"
    if step.cause.name == UNKNOWN:
        return f"{subject}: {step.gain.rmse_before_degC:.2f} degC off, of unknown cause"
    last = diagnosis.explained[-1].gain.rmse_after_degC
    others = f" and {more} more" if (more := len(diagnosis.explained) - 1) else ""
    return f"{subject}: {step.cause}{others}, {diagnosis.bare_degC:.2f} to {last:.2f} degC on held-out data"


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    return mostly(diagnosis) + _verdict(diagnosis)


def mostly(diagnosis: Diagnosis) -> str:
    """What a headline begins with where less than half of what can be explained is."""
    share = diagnosis.explained_share
    return "Mostly unexplained: " if diagnosis.explained and share is not None and share < 0.5 else ""


def _verdict(diagnosis: Diagnosis) -> str:
    step = diagnosis.verdict
    tried = f"{diagnosis.candidates_tried:,} candidates tried, each a cause at a place and an onset,"
    if step is None:
        return (
            f"Nothing is missing: of the {tried} none makes {diagnosis.circuit} predict data it was not fitted to "
            "significantly better, and by enough to matter."
        )
    if step.cause.name == UNKNOWN:
        return f"Something is missing that none of the {tried} explains. {step.sentence}"
    gain, (low, high) = step.gain, step.gain.ci95_degC
    name = noun(step.cause)
    what = [name[0].upper() + name[1:], window(step.onset_s, step.end_s)]
    if step.magnitude is not None:
        what += [magnitude_text(step.magnitude), *filter(None, [step.magnitude.qualifier])]
    others = len(diagnosis.steps) - 1
    more = "" if not others else f" {others} more effect{'s' if others > 1 else ''} found."
    sure = f", {chance(gain.p_value)}" if gain.p_value <= _SMALL_P else ""
    return (
        f"{', '.join(what)}: with it, the error on held-out data falls from {_degrees(gain.rmse_before_degC)} to "
        f"{_degrees(gain.rmse_after_degC)} degC (gain {_degrees(low)} to {_degrees(high)} degC{sure}).{more}"
    )


def noun(cause: Cause) -> str:
    """``cause`` as a noun: ``an unmodelled heat source, at flash, driven by camera_on``."""
    words = next((each.noun for each in kinds().values() if each.cause == cause.name), cause.name.replace("_", " "))
    if cause.location is not None:
        place = str(cause.place)
        words += f", {'between' if '-' in place else 'at'} {place.replace('-', ' and ')}"
    return words + ("" if cause.signal is None else f", driven by {cause.signal}")


def magnitude_text(magnitude: Magnitude | None) -> str:
    """``0.8 W (0.7 to 0.9)``; without the interval where it is of one number, on a scale that is not known."""
    if magnitude is None:
        return "-"
    unit = "" if magnitude.unit in ("", "1") else f" {magnitude.unit}"
    low, high = map(digits, magnitude.ci95)
    shown = f"{digits(magnitude.value)}{unit}"
    return f"{shown} ({low} to {high})" if magnitude.scale_known or low != high else shown


def _facts(diagnosis: Diagnosis) -> Facts:
    time_s = diagnosis.time_s
    span = f"{clock(time_s[0])} to {clock(time_s[-1])}"
    every = duration(float(np.median(np.diff(time_s))))
    pairs: list[tuple[str, str | list[str]]] = [
        ("trace", diagnosis.trace),
        ("circuit", diagnosis.circuit),
        ("time", f"{span}, {len(time_s):,} samples, one every {every}"),
        ("sensors", ", ".join(diagnosis.misfit.sensors)),
        ("baseline", list(diagnosis.baselines) or "none: the question is what the circuit lacks"),
    ]
    for step in diagnosis.explained[:1]:
        pairs.append(("when", window(step.onset_s, step.end_s)))
        if step.magnitude is not None:
            pairs.append(("magnitude", f"{magnitude_text(step.magnitude)}: {step.magnitude.meaning}"))
        pairs.append(("confidence", f"{100 * step.confidence:.1f} %"))
    if (share := diagnosis.explained_share) is not None:
        explained = f"{100 * share:.0f} % of what" if share < 1.0 else "more than"
        left = f"{_degrees(diagnosis.floor_degC or 0.0)} degC"
        pairs.append(("explained", f"{explained} a black box with the same inputs explains, which leaves {left}"))
    return Facts(pairs)


def _causes(diagnosis: Diagnosis) -> Section | None:
    alike = [(step.cause, ", ".join(map(str, step.indistinguishable_from))) for step in diagnosis.steps]
    more = [Finding(f"{cause} is not distinguishable from {rest} by these data.") for cause, rest in alike if rest]
    if diagnosis.next_experiment:
        more.append(Finding(f"Next experiment: {diagnosis.next_experiment}"))
    if not diagnosis.explained:
        return Section("What would show more", more) if more else None
    return Section(
        "The causes, and the gain of each",
        [
            *(step.sentence for step in diagnosis.explained),
            Figure(partial(figures.gains, diagnosis)),
            steps_table(diagnosis),
            Section("What the data do not distinguish, and what would", more) if more else None,
        ],
    )


_AGAINST = (
    "Each point is a mean over a short stretch of time, the line a straight one through them: where points bend away "
    "from it, the driver acts in another form."
)


def _plots(diagnosis: Diagnosis) -> list[Section]:
    misfit, driven = diagnosis.misfit, figures.heat_by_driver(diagnosis)
    in_W = misfit.heat_unit == "W"
    scale = "" if in_W else ": temperatures alone do not give the scale in W, and no logged power sets it"
    beneath = "what drives the causes" if figures.driving(diagnosis) else "what was logged besides and varies"
    simulated = "The circuit is simulated forward from the logged ambient and signals; each panel is a sensor."
    shaded = " A shaded stretch is when a cause acted." if diagnosis.explained else ""
    heat = "What flows into each node beyond the circuit's own flows, C dT/dt less every modelled flow, in "
    residual = "The residual, measured minus simulated, of the circuit as given and after each cause was added."
    backward = "Sensors in, ambient out: the effect of the misfit on the estimate of the ambient."

    def plot(title: str, text: str, draw: Callable[..., Any], *given: Any) -> Section:
        return Section(title, [text, Figure(partial(draw, diagnosis, *given))])

    flows = f"{heat}{misfit.heat_unit}{scale}. Beneath it, {beneath}."
    sections = [
        plot("Measured and simulated", simulated + shaded, figures.simulated),
        plot("The heat that would explain the difference", flows, figures.heat),
        Section("Residuals", [residual, Figure(partial(figures.residuals, diagnosis)), residuals_table(diagnosis)]),
    ]
    if driven is not None:
        sections.insert(2, plot("The heat against its driver", _AGAINST, figures.against_driver, *driven))
    if misfit.ambient_error_degC is not None:
        sections.append(plot("The same circuit read backward", backward, figures.ambient))
    return sections


def _tests(diagnosis: Diagnosis) -> Section:
    tests = diagnosis.misfit.tests
    # any misfit leaves a residual that is not white: what it follows says more
    beyond = sorted((each for each in tests if each.significant), key=lambda each: each.name in _OF_WHITENESS)
    small = "" if diagnosis.steps or not beyond else " What they find is too small to matter."
    found = [Finding(f"{len(beyond)} of {len(tests)} tests of the residual are significant.{small}")]
    found += [Finding(each.sentence, label=each.name) for each in beyond[:SHOWN_RANKED]]
    if (more := len(beyond) - SHOWN_RANKED) > 0:
        found.append(Finding(f"And {more} more: --report or --json shows them all."))
    every = Section("Every test", [residual_tests_table(tests)], detail=True, fold="closed")
    return Section("Tests of the residual", [*found, every])


def _method(diagnosis: Diagnosis) -> Section:
    numbers = []
    for step in (each for each in diagnosis.explained if each.parameters):
        values = [f"{name} = {value:.4g} {unit}".removesuffix(" 1") for name, (value, unit) in step.parameters.items()]
        numbers.append(f"{step.cause}: {', '.join(values)}.")
    return Section("How it was computed", [_METHOD, *numbers], detail=True)


_METHOD = (
    "Every candidate is a small extension of the circuit, fitted to one part of the data and scored on blocks of time, "
    "or whole traces, that it was not fitted to. Effects are added one after the other until none gains. p-values are "
    "corrected for the number of candidates tried and for the residual's autocorrelation; where two candidates fit the "
    "data equally well, the simpler one is selected and the other named."
)


def steps_table(diagnosis: Diagnosis) -> Table:
    """One row a step."""
    caption = (
        "Held-out: the simulation's RMSE over all sensors in degC, on blocks of time that it was not fitted to, "
        "without and with the cause, of causes that are found only together beside all others; the interval "
        "(95 %) is of their difference. p is of a signed-rank test over the blocks, corrected for the "
        f"{diagnosis.candidates_tried:,} candidates tried: few blocks cannot make it small, and it does not decide. "
        f"What is taken, and its confidence, follow from the held-out error.{_scale(diagnosis.explained)}"
    )
    rows = [
        (f"{number}. {step.cause}", *_effect_cells(step), f"{100 * step.confidence:.1f} %")
        for number, step in enumerate(diagnosis.explained, start=1)
    ]
    return Table(caption, ("cause", *_EFFECT, "confidence"), rows, labels=2)


def ranking_table(diagnosis: Diagnosis) -> Table:
    """The best candidates for the first step, and why each was not selected."""
    shown = diagnosis.ranking[:SHOWN_RANKED]
    caption = f"The best {len(shown)} of {diagnosis.candidates_tried:,} candidates for the first effect; RMSE in degC."
    rows = [(str(each.cause), each.remark or "-", *_effect_cells(each)) for each in shown]
    return Table(caption + _scale(shown), ("candidate", "remark", *_EFFECT), rows, labels=3)


def _scale(shown: Sequence[Step | Ranked]) -> str:
    """What a caption says of magnitudes whose scale these data do not determine."""
    known = all(each.magnitude is None or each.magnitude.scale_known for each in shown)
    return "" if known else " Watts are on the scale of the circuit's own capacitances: fix one, or add a power source."


_EFFECT = ("when", "magnitude (95 %)", "held-out RMSE", "gain (95 %)", "p")


def _effect_cells(each: Step | Ranked) -> tuple[str, ...]:
    gain, (low, high) = each.gain, each.gain.ci95_degC
    return (
        window(each.onset_s, each.end_s),
        magnitude_text(each.magnitude),
        f"{_degrees(gain.rmse_before_degC)} → {_degrees(gain.rmse_after_degC)}",
        f"{_degrees(low)} to {_degrees(high)}",
        chance(gain.p_value).removeprefix("p ").removeprefix("= "),
    )


def residual_tests_table(tests: Sequence[Tested]) -> Table:
    """One row a test, the significant ones first."""
    caption = (
        "Thresholds: the textbook's; all but those of whiteness, periodogram and memory hold for any autocorrelation, "
        "and together, so that without any effect one report in 20 is meant to have any significant one; where "
        "half of a residual is white noise and half is slow, it is one in 7."
    )
    columns = ("test", "subject", "result", "statistic", "threshold", "significant")
    rows = [
        (t.name, t.subject, t.sentence, digits(t.statistic), digits(t.threshold), "yes" if t.significant else "no")
        for t in sorted(tests, key=lambda each: not each.significant)
    ]
    return Table(caption, columns, rows, labels=3)


def residuals_table(diagnosis: Diagnosis) -> Table:
    """One row a sensor: what the circuit as given leaves, and what it leaves with every step."""
    last = [step.residual_degC for step in diagnosis.explained[-1:]]
    rows = []
    for number, (sensor, own) in enumerate(_residuals(diagnosis).items()):
        after = [_degrees(_figures(diagnosis, each[number])["rmse_degC"]) for each in last]
        span = duration(own["memory_s"]) if math.isfinite(own["memory_s"]) else "-"
        rows.append((sensor, _degrees(own["rmse_degC"]), *after, _degrees(own["std_degC"]), span))
    caption = "In degC, over the whole trace. Correlation time: until the residual's autocorrelation is 1/e."
    return Table(caption, ("sensor", "RMSE", *["RMSE with every step"] * len(last), "std", "correlation time"), rows)


def as_data(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of ``diagnose --json``; a number that is not finite is null."""
    steps = [_step_data(step) for step in diagnosis.steps]
    data = {
        "trace": diagnosis.trace,
        "circuit": diagnosis.circuit,
        "baselines": diagnosis.baselines,
        "steps": steps,
        "verdict": steps[0] if steps else _nothing(diagnosis),
        "ranking": [{**_effect_data(each), "remark": each.remark} for each in diagnosis.ranking],
        "residuals": {
            "sensors": _residuals(diagnosis),
            "heat_unit": diagnosis.misfit.heat_unit,
            "tests": [asdict(each) for each in diagnosis.misfit.tests],
        },
        "next_experiment": diagnosis.next_experiment,
        "candidates_tried": diagnosis.candidates_tried,
        "bare_degC": diagnosis.bare_degC,
        "floor_degC": diagnosis.floor_degC,
        "explained_share": diagnosis.explained_share,
        "notes": diagnosis.notes,
    }
    return finite(data)


def _effect_data(each: Step | Ranked) -> dict[str, Any]:
    return {
        **_cause_data(each.cause),
        "onset_s": each.onset_s,
        "end_s": each.end_s,
        "magnitude": None if each.magnitude is None else asdict(each.magnitude),
        "gain": {**asdict(each.gain), "held_out": True},
    }


def _step_data(step: Step) -> dict[str, Any]:
    return {
        **_effect_data(step),
        "confidence": step.confidence,
        "indistinguishable_from": [_cause_data(each) for each in step.indistinguishable_from],
        "sentence": step.sentence,
        "parameters": {name: {"value": value, "unit": unit} for name, (value, unit) in step.parameters.items()},
    }


def _nothing(diagnosis: Diagnosis) -> dict[str, Any]:
    """The verdict where nothing is missing, with the keys that every step has."""
    empty = dict.fromkeys(("onset_s", "end_s", "magnitude", "gain", "confidence"))
    rest = {"indistinguishable_from": [], "sentence": headline(diagnosis), "parameters": {}}
    return {**_cause_data(Cause(NONE)), **empty, **rest}


def _cause_data(cause: Cause) -> dict[str, Any]:
    return {"cause": cause.name, "location": cause.location, "signal": cause.signal}


def _degrees(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "-"


def _residuals(diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    """The figures of what the circuit as given leaves, by sensor."""
    misfit = diagnosis.misfit
    return {sensor: _figures(diagnosis, row) for sensor, row in zip(misfit.sensors, misfit.residual_degC)}


def _figures(diagnosis: Diagnosis, values: Array) -> dict[str, float]:
    """Root mean square, standard deviation and autocorrelation time of a residual (N,); NaN where nothing is known."""
    known = pd.Series(values[np.isfinite(values)])
    rmse, time_s = float(np.sqrt((known**2).mean())), correlation_s(diagnosis.time_s, values)
    return {"rmse_degC": rmse, "std_degC": float(known.std(ddof=0)), "memory_s": time_s}
