"""The report of a search: which sensors, how many of them, which circuit."""

import math
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.report import Facts, Figure, Finding, Plot, Report, Section, Table
from ambient_trainer.report.palette import BASELINE, BLUE, GREY, INK, ORANGE, SAND, SENSOR_COLOURS, SKY
from ambient_trainer.report.plots import add_curve, matrix_figure, panel_figure
from ambient_trainer.selection.search import NEAR_DEGC, SearchResult, SelectedCircuit, SelectedSet, counted, flat_from

_NAMED_ALTERNATIVES = 3
_CIRCUITS = (
    "A line is the wider the more heat it conducts; over its middle its resistance is shown. Temperatures alone give "
    "ratios of resistances, not their scale."
)
_ERRORS = (
    "Held out: blocks of time that the estimate was not fitted to. Dotted: whole traces that nothing was chosen by, by "
    "the same filters."
)
_GAINS = (
    "By how much the estimate rises in the steady state when one sensor reads one degree more. Each column sums to one."
)
_FILTERS = (
    "Each filter has the same fixed poles and gains that sum to one in the steady state; sensors were chosen by its "
    "error on blocks that were left out in turn, each with a gap on either side."
)


def report_of(result: SearchResult) -> Report:
    """What the search says, for the terminal, a machine and a page."""
    main, *others = findings(result)
    data, free, wired = result.data, f"free-{result.data.options.order}", result.circuits.values()
    paths = [each.path for each in data.traces]
    fitted = f"{sum(each.tried for each in wired):,} fitted, one sample every {data.circuit_period_s:g} s"
    facts = [
        ("traces", paths),
        ("zones", f"{len(data.sensors)} searched, {len(data.left_out)} left out"),
        ("sets of sensors", f"{result.sets_tried:,} scored, one sample every {data.period_s:g} s"),
        ("circuits", fitted if wired else "not searched"),
        ("sensors' errors", f"as if each had {data.options.tolerance_degC:g} degC more, of noise and constant"),
    ]
    errors, gains = Figure(partial(errors_figure, result), _ERRORS), Figure(partial(gains_figure, result))
    circuits: list[Section | str] = [_CIRCUITS] if wired else []
    for each in wired:
        title = f"{', '.join(each.topology.sensors)}: {each.rmse_degC:.2f} degC held out"
        circuits.append(Section(title, [Figure(partial(circuit_figure, each))]))
    checks = checks_table(result) if result.checks else None
    fit = ["--circuit", free, "--sensors", ",".join(result.recommended.sensors), "-o", "MODEL.json"]
    command = shlex.join(["ambient-trainer", "fit", *paths, *fit])
    return Report(
        subject="Search for sensors and circuits",
        title=main,
        lead=[Facts(facts)],
        sections=[
            Section("Number of sensors", [sizes_table(result), *map(Finding, others), errors, checks]),
            Section("DC gains of the sensors", [_GAINS, gains]),
            Section("The best circuit of each size", circuits),
            Section("Zones left out", [*map(Finding, left_out_lines(data.left_out))], detail=True),
            Section("", [Finding(f"Next: {command}")]),
        ],
        data=as_json(result),
        footnotes=[_FILTERS],
    )


def sizes_table(result: SearchResult) -> Table:
    """One row a number of sensors."""
    free, blocks = f"free-{result.data.options.order}", _blocks_data(result)
    columns = ("sensors", "which", "held out", "one standard error", "noise", free, "circuit", "its states")
    rows = []
    for each in result.sets:
        low, high = each.interval_degC
        errors = f"{each.rmse_degC:.2f}", f"{low:.2f} to {high:.2f}", f"{each.noise_degC:.2f}"
        wired = ("-", "-")
        if circuit := result.circuits.get(len(each.sensors)):
            kind = "hidden" if circuit.topology.form == "temperature" else "own"
            wired = (f"{circuit.rmse_degC:.2f}", f"{len(circuit.topology.states)} {kind}")
        rows.append((_label(result, each), ", ".join(each.sensors), *errors, f"{each.free.rmse_degC:.2f}", *wired))
    caption = (
        f"RMSE in degC on {blocks['count']} blocks of {blocks['length_s']:.0f} s, each left out of the fit with "
        f"{blocks['gap_s']:.0f} s on either side: of the filter over fixed poles "
        f"({', '.join(f'{each:g}' for each in result.poles_s)} s) that the sensors are chosen with, of {free} with its "
        "poles fitted, and of the best circuit. Noise: what the sensors' own makes in the estimate. *: the fewest "
        "within one standard error of the least."
    )
    return Table(caption, columns, rows, labels=2)


def checks_table(result: SearchResult) -> Table:
    """The same score on traces that had no part in the selection."""
    kinds = ["filter", f"free-{result.data.options.order}", *(["circuit"] if result.circuits else [])]
    columns = ("sensors", *(f"{_name(path)} {kind}" for path in result.checks for kind in kinds))
    rows = []
    for each in result.sets:
        circuit = None if each is result.against else result.circuits.get(len(each.sensors))
        scored = [one and one.checks_degC for one in (each, each.free, circuit)[: len(kinds)]]
        cells = (f"{of[k]:.2f}" if of else "-" for k in range(len(result.checks)) for of in scored)
        rows.append((_label(result, each), *cells))
    return Table("RMSE in degC on traces that nothing was chosen or fitted by, from a cold start.", columns, rows)


def left_out_lines(left_out: Mapping[str, str]) -> list[str]:
    """A line a zone that the search does without."""
    return [f"Left out: {column.removesuffix('_degC')}: {why}." for column, why in left_out.items()]


def findings(result: SearchResult) -> Iterator[str]:
    """The findings in sentences, the most important first."""
    errors = [each.rmse_degC for each in result.sizes]
    named, least = result.recommended, min(result.sizes, key=lambda each: each.rmse_degC)
    on = f"held-out blocks{' (simulated)' * result.data.simulated}"
    yield f"{counted(len(named.sensors))}, {_all_of(named.sensors)}: RMSE {named.rmse_degC:.2f} degC on {on}"
    if least is not named:
        up = f"one standard error up it is {least.interval_degC[1]:.2f}"
        yield f"The least is {least.rmse_degC:.2f} degC, with {len(least.sensors)}; {up}."
    flat = flat_from(errors, NEAR_DEGC)
    if flat < len(errors) - 1:
        yield f"From {counted(flat + 1)} on no further one gains more than {NEAR_DEGC:g} degC."
    for out in named.sensors:
        if others := [each.into for each in named.alternatives if each.out == out]:
            hidden = len(others) - _NAMED_ALTERNATIVES
            more = f" or one of {hidden} more" if hidden > 0 else ""
            yield f"{out} or {' or '.join(others[:_NAMED_ALTERNATIVES])}{more}: within {NEAR_DEGC:g} degC."
    yield from _against(result)
    if not result.circuits:
        return
    best = min(result.circuits.values(), key=lambda each: each.rmse_degC)
    tried, topology = sum(each.tried for each in result.circuits.values()), best.topology
    kind = "hidden nodes behind the sensors" if topology.form == "temperature" else "the sensors' own nodes"
    states = f"{len(topology.states)} states, {kind}, and {len(topology.edges)} edges"
    of = f"Of {tried} circuits the best, of {_all_of(topology.sensors)}"
    yield f"{of}, has {states}: {best.rmse_degC:.2f} degC held out."
    if result.unnamed:
        yield f"No circuit has {', '.join(result.unnamed)}: a circuit file cannot hold such a name."


def as_json(result: SearchResult) -> dict[str, Any]:
    """The content of ``search --json``."""
    data, sizes, against = result.data, result.sizes, result.against
    errors = [each.rmse_degC for each in sizes]
    better = [all(error < other for other in errors[:index]) for index, error in enumerate(errors)]
    return {
        "traces": [each.path for each in data.traces],
        "simulated": data.simulated,
        "options": asdict(data.options),
        "period_s": data.period_s,
        "circuit_period_s": data.circuit_period_s,
        "poles_s": list(result.poles_s),
        "blocks": _blocks_data(result),
        "sensors": [asdict(each) for each in data.sensors],
        "left_out": [{"column": column, "why": why} for column, why in data.left_out.items()],
        "sets_tried": result.sets_tried,
        "sizes": [_size_data(each, result.circuits.get(len(each.sensors))) for each in sizes],
        "front": [len(each.sensors) for each, is_better in zip(sizes, better) if is_better],
        "named": len(result.recommended.sensors),
        "against": against and _size_data(against, None),
        "checks": [
            {
                "trace": path,
                "filter_rmse_degC": [each.checks_degC[k] for each in sizes],
                "free_rmse_degC": [each.free.checks_degC[k] for each in sizes],
                "circuit_rmse_degC": {str(size): each.checks_degC[k] for size, each in result.circuits.items()},
                "against_rmse_degC": against
                and {"filter": against.checks_degC[k], "free": against.free.checks_degC[k]},
            }
            for k, path in enumerate(result.checks)
        ],
    }


def _blocks_data(result: SearchResult) -> dict[str, float]:
    data = result.data
    length = float(np.median([each.stop - each.start for each in data.blocks]))
    gap = max(each.start - each.first for each in data.blocks)
    return {"count": len(data.blocks), "length_s": length * data.period_s, "gap_s": gap * data.period_s}


def _name(path: str) -> str:
    """A trace's file without its folder and endings."""
    return os.path.basename(path).removesuffix(".gz").removesuffix(".csv")


def _label(result: SearchResult, each: SelectedSet) -> str:
    return "given" if each is result.against else f"{len(each.sensors)}{' *' * (each is result.recommended)}"


def _against(result: SearchResult) -> Iterator[str]:
    """The named set beside the best set of as many sensors, held out and on every check."""
    against = result.against
    if against is None or len(against.sensors) > len(result.sizes):
        return
    best = result.sizes[len(against.sensors) - 1]
    parts = [f"{best.rmse_degC:.2f} degC against {against.rmse_degC:.2f} held out"]
    for path, ours, theirs in zip(result.checks, best.checks_degC, against.checks_degC):
        parts.append(f"{ours:.2f} against {theirs:.2f} on {_name(path)}")
    yield f"The best {len(best.sensors)} beside {_all_of(against.sensors)}: {', '.join(parts)}."


def _size_data(each: SelectedSet, circuit: SelectedCircuit | None) -> dict[str, Any]:
    return {
        "sensors": list(each.sensors),
        **_held_out_data(each),
        "noise_gain": each.noise_gain,
        "noise_degC": each.noise_degC,
        "dc_gains": list(each.dc_gains),
        "offset_degC": float(each.system.offset[0]),
        "free_held_out_rmse_degC": each.free.rmse_degC,
        "alternatives": [asdict(other) for other in each.alternatives],
        "circuit": circuit
        and {
            "name": circuit.circuit.name,
            **asdict(circuit.topology),
            **_held_out_data(circuit),
            "tried": circuit.tried,
        },
    }


def _held_out_data(scored: SelectedSet | SelectedCircuit) -> dict[str, Any]:
    return {
        "held_out_rmse_degC": scored.rmse_degC,
        "one_standard_error_degC": list(scored.interval_degC),
        "block_rmse_degC": [(square / count) ** 0.5 for square, count in zip(scored.squares, scored.samples)],
    }


def _all_of(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


_THINNEST_PX, _THICKEST_PX = 1.0, 7.0
_CHECK_COLOURS = tuple(SENSOR_COLOURS[each] for each in (2, 3, 5, 6))


def errors_figure(result: SearchResult) -> Plot:
    """Held-out error by number of sensors, and what the same filters score elsewhere."""
    figure = panel_figure("sensors", "error, RMSE [°C]", height_px=460)
    counts = [len(each.sensors) for each in result.sizes]
    errors, ends = [each.rmse_degC for each in result.sizes], [each.interval_degC for each in result.sizes]
    hover = ["\n".join(each.sensors) for each in result.sizes]
    add_curve(figure, counts, errors, "held out, one standard error", BLUE, width=2.4, ends=ends, hover=hover)
    free = [each.free.rmse_degC for each in result.sizes]
    add_curve(figure, counts, free, f"held out, free-{result.data.options.order}", BASELINE)
    if result.circuits:
        wired = [each.rmse_degC for each in result.circuits.values()]
        add_curve(figure, list(result.circuits), wired, "held out, best circuit", ORANGE)
    for k, (path, colour) in enumerate(zip(result.checks, _CHECK_COLOURS)):
        add_curve(figure, counts, [each.checks_degC[k] for each in result.sizes], _name(path), colour, dash="dot")
    given: dict[str, object] = {"marker": {"symbol": "x", "size": 10, "color": INK}}
    given["hovertemplate"] = "%{y:.3f} °C<br>%{text}<extra></extra>"
    ring = {"marker": {"symbol": "circle-open", "size": 20, "color": BLUE, "line": {"width": 2}}, "hoverinfo": "skip"}
    for name, each, look in (
        ("held out, the given set", result.against, given),
        ("fewest within one standard error", result.recommended, ring),
    ):
        if each is not None:
            place = {"x": [len(each.sensors)], "y": [each.rmse_degC], "text": [", ".join(each.sensors)]}
            figure.add_scatter(**place, name=name, mode="markers", **look)
    figure.update_xaxes(tickvals=counts, hoverformat="d", tickformat="d", range=[min(counts) - 0.4, max(counts) + 0.4])
    figure.update_yaxes(type="log", tickvals=[0.05, 0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20])
    return figure


def gains_figure(result: SearchResult) -> Plot:
    """Which sensors are in which set, by their DC gains."""
    names = list(dict.fromkeys(name for each in result.sizes for name in each.sensors))
    gains = [dict(zip(each.sensors, each.dc_gains)) for each in result.sizes]
    return matrix_figure(
        [str(len(each.sensors)) for each in result.sizes],
        names,
        [[each.get(name) for each in gains] for name in names],
        [[f"{each[name]:+.2f}" if name in each else "" for each in gains] for name in names],
        x_title="sensors",
    )


def circuit_figure(selected: SelectedCircuit) -> Plot:
    """The circuit: sensors on a ring, what is not measured within it."""
    circuit, topology = selected.circuit, selected.topology
    inner = [AMBIENT] if topology.form == "rise" else list(topology.states)
    places = {**_ring(topology.sensors, 1.0), **_ring(inner, 0.42 if len(inner) > 1 else 0.0)}
    values = {each.name: each.initial for each in circuit.parameters}
    largest = max(1 / values[each.resistance] for each in circuit.edges)
    figure = panel_figure("", "", height_px=340)
    for edge in circuit.edges:
        (x0, y0), (x1, y1) = places[edge.between[0]], places[edge.between[1]]
        share = 1 / values[edge.resistance] / largest
        colour = SAND if AMBIENT in edge.between else GREY
        width = _THINNEST_PX + (_THICKEST_PX - _THINNEST_PX) * math.sqrt(share)
        figure.add_scatter(x=[x0, x1], y=[y0, y1], mode="lines", line={"color": colour, "width": width},
                           hoverinfo="skip", showlegend=False)  # fmt: skip
        figure.add_scatter(x=[(x0 + x1) / 2], y=[(y0 + y1) / 2], mode="markers", marker={"size": 12, "opacity": 0},
                           text=[f"{'-'.join(edge.between)}: {values[edge.resistance]:.3g} K/W"],
                           hovertemplate="%{text}<extra></extra>", showlegend=False)  # fmt: skip
    kinds = {"sensor": [each for each in topology.sensors if each not in topology.states],
             "sensor with a heat capacity": [each for each in topology.states if each in topology.sensors],
             "hidden node": [each for each in topology.states if each not in topology.sensors],
             "ambient": [each for each in inner if each == AMBIENT]}  # fmt: skip
    for (kind, names), colour in zip(kinds.items(), (SKY, BLUE, ORANGE, SAND)):
        if names:
            x, y = zip(*(places[name] for name in names))
            marker = {"size": 16, "color": colour, "line": {"width": 1.5, "color": "white"}}
            sides = ["bottom center" if each < 0 else "top center" for each in y]
            look = {"mode": "markers+text", "textposition": sides, "marker": marker, "hoverinfo": "skip"}
            figure.add_scatter(x=x, y=y, name=kind, text=names, **look)
    figure.update_xaxes(visible=False, range=[-1.5, 1.5])
    figure.update_yaxes(visible=False, range=[-1.35, 1.35])
    figure.update_layout(margin={"l": 4, "r": 4, "t": 30, "b": 4})
    return figure


def _ring(names: Sequence[str], radius: float) -> dict[str, tuple[float, float]]:
    """Places on a circle, the first at the top."""
    angles = [math.pi / 2 + 2 * math.pi * (k + (0.5 if radius < 1 else 0.0)) / len(names) for k in range(len(names))]
    return {name: (radius * math.cos(angle), radius * math.sin(angle)) for name, angle in zip(names, angles)}
