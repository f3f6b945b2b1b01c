"""``ambient-trainer join``: the traces of several loggers become one, and the shift between their clocks is shown."""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from ambient_trainer import cli
from ambient_trainer.report import Finding, Report, Status, Table

if TYPE_CHECKING:
    from ambient_trainer.data.join import Logged
    from ambient_trainer.evaluation.clock_shift import ClockShift


@click.command("join")
@click.argument("trace_paths", metavar="TRACE TRACE...", nargs=-1, required=True)
@click.option("--shift", "apply", is_flag=True, help="Move each clock by the shift that was found.")
@click.option(
    "--within",
    "within_s",
    type=cli.FiniteRange(0, min_open=True),
    metavar="S",
    show_default="half of the shorter trace",
    help="Largest shift to search.",
)
@cli.output_options("the shifts")
@click.option("-o", "trace_out", metavar="TRACE", required=True, help="The joined trace; .gz compresses it.")
def command(
    trace_paths: tuple[str, ...], apply: bool, within_s: float | None, output: cli.Output, trace_out: str
) -> None:
    """Join the traces of several loggers on the clock and the stamps of the first.

    The shift between two clocks is estimated from a column that both have, such as ambient_degC; without one, from a
    column of one that drives a column of the other. It is shown with its 95 % interval, and applied only by --shift.
    Repeated stamps are left out. A column of a name that is taken gets a number, such as ambient_2_degC.
    """
    from ambient_trainer.data.join import joined, load_logged, on_one_epoch  # scipy: --help should not wait for it
    from ambient_trainer.data.trace import save_trace
    from ambient_trainer.evaluation.clock_shift import clock_shift

    if len(trace_paths) < 2:
        raise click.UsageError("one trace is joined already: name two or more")
    output.check(trace_paths, [trace_out])
    first, *others = on_one_epoch([load_logged(path) for path in trace_paths])
    shifts = [clock_shift(first.moved(), other.moved(), within_s) for other in others]
    statuses: list[Status] = ["plain" if each.comparable else "warning" for each in others]
    moves_s = [each.shift_s if apply and each is not None and each.significant else 0.0 for each in shifts]
    trace = joined([first.moved(), *[other.moved(move_s) for other, move_s in zip(others, moves_s)]])
    moved = {f"shift_{os.path.basename(each.trace.path)}": f"{by:g} s" for each, by in zip(others, moves_s) if by}
    trace.notes.update(moved)
    save_trace(trace_out, trace)
    blocks: list[Any] = [
        Table("", ("trace", "samples", "rows left out", "shift", "95 %", "by"), list(map(_row, others, shifts))),
        *map(Finding, map(_sentence, others, shifts, moves_s), statuses),
    ]
    data = {"samples": len(trace.time_s), "columns": list(trace.columns), "traces": [
        _data(*each) for each in zip([first, *others], [None, *shifts], [0.0, *moves_s])
    ]}  # fmt: skip
    output.show(Report(f"{len(trace.columns)} columns of {len(trace_paths)} traces", blocks, [], data))
    click.echo(f"wrote {trace_out}")


def _row(logged: Logged, shift: ClockShift | None) -> tuple[str, ...]:
    cells = ("-", "-", "-")
    if shift is not None:
        low, high = shift.ci95_s
        cells = (f"{shift.shift_s:.4g} s", f"{low:.4g} to {high:.4g} s", " and ".join(dict.fromkeys(shift.columns)))
    return (os.path.basename(logged.trace.path), f"{len(logged.trace.time_s):,}", str(logged.dropped_rows), *cells)


def _sentence(logged: Logged, shift: ClockShift | None, moved_s: float) -> str:
    name = os.path.basename(logged.trace.path)
    start, unclear = f"{name} is placed by {logged.epoch}. ", "Whether its clock is shifted is not determined"
    if shift is None:
        return f"{start}{unclear}: no two columns change together."
    if shift.problem is not None:
        return f"{start}{unclear} by {' and '.join(shift.columns)}: {shift.problem}."
    if not shift.significant:
        return start + "Its clock is not shifted: the interval holds 0."
    late = "behind" if shift.shift_s > 0 else "ahead"
    done = "it was moved" if moved_s else "--shift moves it"
    lags = " A delay of the bodies themselves would count as a shift." if shift.lags_s else ""
    return f"{start}Its clock is {abs(shift.shift_s):.4g} s {late}: {done}.{lags}"


def _data(logged: Logged, shift: ClockShift | None, applied_s: float) -> dict[str, Any]:
    return {
        "trace": logged.trace.path,
        "samples": len(logged.trace.time_s),
        "dropped_rows": logged.dropped_rows,
        "epoch_s": logged.epoch_s,
        "shift": None if shift is None else {**asdict(shift), "significant": shift.significant},
        "applied_s": applied_s,
    }
