"""The report of a search: which sensors, how many of them, which circuit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from ambient_trainer.report import Facts, Figure, Finding, Report, Section, Table
from ambient_trainer.selection.figures import circuit_figure, errors_figure, gains_figure
from ambient_trainer.selection.found import Check, Chosen, Found, FoundCircuit
from ambient_trainer.selection.front import HeldOut, flat_from, pareto_front

GAIN_DEGC = 0.02
"""A further sensor that gains less gains nothing that matters."""
_NAMED_ALTERNATIVES = 3
_CIRCUITS = (
    "A line is the wider the more heat it conducts; over its middle its resistance is shown. Temperatures alone tell "
    "ratios of resistances, not their scale."
)


def report_of(found: Found) -> Report:
    """What the search says, for the terminal, a machine and a page."""
    main, *others = findings(found)
    return Report(
        subject="Search for sensors and circuits",
        title=main,
        lead=[_facts(found)],
        sections=[
            Section(
                "Number of sensors",
                [
                    sizes_table(found),
                    *map(Finding, others),
                    Figure(
                        partial(errors_figure, found),
                        "Held out: blocks of time that the estimate was not fitted to. Dotted: whole traces that chose "
                        "nothing, by the same filters.",
                    ),
                    checks_table(found) if found.checks else None,
                ],
            ),
            Section(
                "DC gains of the sensors",
                [
                    "By how much the estimate rises in the steady state when one sensor reads one degree more. Each "
                    "column sums to one.",
                    Figure(partial(gains_figure, found)),
                ],
            ),
            Section("The best circuit of each size", [_CIRCUITS, *map(_circuit_section, found.circuits.values())])
            if found.circuits
            else Section("", []),
            Section("Zones left out", [*map(Finding, left_out_lines(found.left_out))], detail=True),
            Section("", [Finding(_next(found))]),
        ],
        data=as_json(found),
        footnotes=[
            "Each filter has the same fixed poles and gains that sum to one in the steady state; sensors were chosen "
            "by its error on blocks that were left out in turn, each with a gap on either side."
        ],
    )


def sizes_table(found: Found) -> Table:
    """One row a number of sensors."""
    free = f"free-{found.options.order}"
    columns = ("sensors", "which", "held out", "one standard error", "noise", free, "circuit", "its states")
    rows = [_row(f"{len(each.sensors)}{' *' * (index == found.named)}", each, found.circuits.get(len(each.sensors)))
            for index, each in enumerate(found.sizes)]  # fmt: skip
    if found.against is not None:
        rows.append(_row("given", found.against, None))
    caption = (
        f"RMSE in degC on {found.blocks} blocks of {found.block_s:.0f} s, each left out of the fit with "
        f"{found.gap_s:.0f} s on either side: of the filter over fixed poles ({_seconds(found.poles_s)}) that the "
        f"sensors are chosen with, of {free} with its poles fitted, and of the best circuit. Noise: what the sensors' "
        "own makes in the estimate. "
        "*: the fewest within one standard error of the least."
    )
    return Table(caption, columns, tuple(rows), labels=2)


def checks_table(found: Found) -> Table:
    """What the same score on traces that chose nothing."""
    kinds = ["filter", f"free-{found.options.order}", *(["circuit"] if found.circuits else [])]
    columns = ("sensors", *(f"{each.name} {kind}" for each in found.checks for kind in kinds))
    rows = []
    for index, size in enumerate(found.sizes):
        cells = [figure for each in found.checks for figure in _figures(each, index, bool(found.circuits))]
        rows.append((f"{len(size.sensors)}{' *' * (index == found.named)}", *cells))
    if found.against is not None:
        blank = ["-"] if found.circuits else []
        cells = [cell for each in found.checks for cell in (*map(_degC, each.against or ()), *blank)]
        rows.append(("given", *cells))
    caption = "RMSE in degC on traces that chose nothing and taught nothing, from a cold start."
    return Table(caption, columns, tuple(rows))


def left_out_lines(left_out: Sequence[Any]) -> list[str]:
    """A line a zone that the search does without."""
    return [f"Left out: {each.column.removesuffix('_degC')}: {each.why}." for each in left_out]


def findings(found: Found) -> list[str]:
    """What the search found in sentences, the most important first."""
    errors = [each.held_out.rmse_degC for each in found.sizes]
    named, least = found.sizes[found.named], min(found.sizes, key=lambda each: each.held_out.rmse_degC)
    on = "held-out blocks (simulated)" if found.simulated else "held-out blocks"
    lines = [f"{_count(named)}, {_all_of(named.sensors)}: RMSE {named.held_out.rmse_degC:.2f} degC on {on}"]
    if least is not named:
        lines.append(
            f"The least is {least.held_out.rmse_degC:.2f} degC, with {len(least.sensors)}; one standard error up it is "
            f"{least.held_out.band_degC[1]:.2f}."
        )
    flat = flat_from(errors, GAIN_DEGC)
    if flat < len(errors) - 1:
        lines.append(f"From {_count(found.sizes[flat])} on no further one gains more than {GAIN_DEGC:g} degC.")
    lines += _alternatives(named)
    lines += _against(found)
    lines += _circuit_lines(found)
    return lines


def as_json(found: Found) -> dict[str, Any]:
    """The content of ``search --json``."""
    front = pareto_front([each.held_out.rmse_degC for each in found.sizes])
    return {
        "traces": list(found.traces),
        "simulated": found.simulated,
        "options": asdict(found.options),
        "period_s": found.period_s,
        "circuit_period_s": found.circuit_period_s,
        "poles_s": list(found.poles_s),
        "blocks": {"count": found.blocks, "length_s": found.block_s, "gap_s": found.gap_s},
        "sensors": [asdict(each) for each in found.sensors],
        "left_out": [asdict(each) for each in found.left_out],
        "sets_tried": found.sets_tried,
        "sizes": [_size_data(each, found.circuits.get(len(each.sensors))) for each in found.sizes],
        "front": [len(found.sizes[each].sensors) for each in front],
        "named": len(found.sizes[found.named].sensors),
        "against": found.against and _size_data(found.against, None),
        "checks": [
            {
                "trace": each.path,
                "filter_rmse_degC": list(each.filters),
                "free_rmse_degC": list(each.free),
                "circuit_rmse_degC": {str(size): rmse for size, rmse in each.circuits.items()},
                "against_rmse_degC": each.against and {"filter": each.against[0], "free": each.against[1]},
            }
            for each in found.checks
        ],
    }


def _facts(found: Found) -> Facts:
    tried = sum(each.tried for each in found.circuits.values())
    fitted = f"{tried:,} fitted, one sample every {found.circuit_period_s:g} s"
    return Facts(
        [
            ("traces", found.traces),
            ("zones", f"{len(found.sensors)} searched, {len(found.left_out)} left out"),
            ("sets of sensors", f"{found.sets_tried:,} scored, one sample every {found.period_s:g} s"),
            ("circuits", fitted if found.circuits else "not searched"),
            ("sensors' errors", f"as if each had {found.options.tolerance_degC:g} degC more, of noise and constant"),
        ]
    )


def _circuit_section(each: FoundCircuit) -> Section:
    title = f"{', '.join(each.wiring.sensors)}: {each.held_out.rmse_degC:.2f} degC held out"
    return Section(title, [Figure(partial(circuit_figure, each))])


def _next(found: Found) -> str:
    sensors = ",".join(found.sizes[found.named].sensors)
    circuit = f"--circuit free-{found.options.order} --sensors {sensors}"
    return f"Next: ambient-trainer fit {' '.join(found.traces)} {circuit} -o MODEL.json"


def _row(label: str, each: Chosen, circuit: FoundCircuit | None) -> tuple[str, ...]:
    low, high = each.held_out.band_degC
    wired = (_degC(circuit.held_out.rmse_degC), _states(circuit)) if circuit else ("-", "-")
    held_out, free = _degC(each.held_out.rmse_degC), _degC(each.free.held_out.rmse_degC)
    which = ", ".join(each.sensors)
    return (label, which, held_out, f"{low:.2f} to {high:.2f}", _degC(each.noise_degC), free, *wired)


def _states(circuit: FoundCircuit) -> str:
    count = len(circuit.wiring.states)
    return f"{count} hidden" if circuit.wiring.form == "temperature" else f"{count} own"


def _figures(check: Check, index: int, circuits: bool) -> list[str]:
    own = [_degC(check.filters[index]), _degC(check.free[index])]
    wired = check.circuits.get(index + 1)
    return [*own, "-" if wired is None else _degC(wired)] if circuits else own


def _alternatives(named: Chosen) -> list[str]:
    lines = []
    for out in named.sensors:
        others = [each for each in named.alternatives if each.out == out]
        if others:
            shown = [each.into for each in others[:_NAMED_ALTERNATIVES]]
            more = f" or one of {len(others) - len(shown)} more" if len(others) > len(shown) else ""
            lines.append(f"{out} or {' or '.join(shown)}{more}: within {GAIN_DEGC:g} degC.")
    return lines


def _against(found: Found) -> list[str]:
    """The named set beside the best set of as many sensors, held out and on every check."""
    against = found.against
    if against is None or len(against.sensors) > len(found.sizes):
        return []
    index = len(against.sensors) - 1
    best = found.sizes[index]
    parts = [f"{best.held_out.rmse_degC:.2f} degC against {against.held_out.rmse_degC:.2f} held out"]
    for each in found.checks:
        if each.against is not None:
            parts.append(f"{each.filters[index]:.2f} against {each.against[0]:.2f} on {each.name}")
    return [f"The best {len(best.sensors)} beside {_all_of(against.sensors)}: {', '.join(parts)}."]


def _circuit_lines(found: Found) -> list[str]:
    if not found.circuits:
        return []
    best = min(found.circuits.values(), key=lambda each: each.held_out.rmse_degC)
    tried = sum(each.tried for each in found.circuits.values())
    kind = "hidden nodes behind the sensors" if best.wiring.form == "temperature" else "the sensors' own nodes"
    lines = [
        f"Of {tried} circuits the best, of {_all_of(best.wiring.sensors)}, has {len(best.wiring.states)} states, "
        f"{kind}, and {len(best.wiring.edges)} edges: {best.held_out.rmse_degC:.2f} degC held out."
    ]
    if found.unnamed:
        lines.append(f"No circuit has {', '.join(found.unnamed)}: a circuit file cannot hold such a name.")
    return lines


def _size_data(each: Chosen, circuit: FoundCircuit | None) -> dict[str, Any]:
    return {
        "sensors": list(each.sensors),
        **_held_out_data(each.held_out),
        "noise_gain": each.noise_gain,
        "noise_degC": each.noise_degC,
        "dc_gains": list(each.filter.dc_gains),
        "offset_degC": each.filter.offset_degC,
        "free_held_out_rmse_degC": each.free.held_out.rmse_degC,
        "alternatives": [asdict(other) for other in each.alternatives],
        "circuit": circuit
        and {
            "name": circuit.circuit.name,
            "form": circuit.wiring.form,
            "sensors": list(circuit.wiring.sensors),
            "states": list(circuit.wiring.states),
            "edges": [list(edge) for edge in circuit.wiring.edges],
            **_held_out_data(circuit.held_out),
            "tried": circuit.tried,
        },
    }


def _held_out_data(held_out: HeldOut) -> dict[str, Any]:
    return {
        "held_out_rmse_degC": held_out.rmse_degC,
        "one_standard_error_degC": list(held_out.band_degC),
        "block_rmse_degC": [(square / count) ** 0.5 for square, count in zip(held_out.squares, held_out.samples)],
    }


def _count(each: Chosen) -> str:
    return f"{len(each.sensors)} sensor{'s' * (len(each.sensors) > 1)}"


def _all_of(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _seconds(values: Sequence[float]) -> str:
    return ", ".join(f"{each:g}" for each in values) + " s"


def _degC(value: float) -> str:
    return f"{value:.2f}"
