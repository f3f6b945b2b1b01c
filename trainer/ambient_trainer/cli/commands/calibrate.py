"""``ambient-trainer calibrate``: the probes' offsets from a reference thermometer in the same bath."""

from __future__ import annotations

import contextlib
import datetime
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import click
from rich.console import Console

from ambient_model.atomic import replacing
from ambient_model.faults import refuse
from ambient_trainer.cli.number import FiniteRange
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer
from ambient_trainer.report.table import Table, for_terminal

if TYPE_CHECKING:
    from ambient_trainer.laboratory.instruments.bath_run import BathLab, BathRun
    from ambient_trainer.laboratory.instruments.calibration import Bath, Settled
    from ambient_trainer.laboratory.instruments.offsets import ProbeTable

_UNIT = "_degC"
_REFERENCE = "bath_degC"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*")
_PATIENCE_S = 3600.0


class _Links(NamedTuple):
    """What the command line says of the instruments."""

    thermometer: str | None
    multiplexer: str | None
    probes: dict[str, int]
    thermocouple: str
    baud: int
    address: int


@click.command("calibrate")
@click.argument("trace_path", metavar="[TRACE.csv]", required=False)
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False), help="The offsets, as YAML.")
@click.option("--thermometer", metavar="PORT", help="The reference, a Greisinger GMH.")
@click.option("--multiplexer", metavar="PORT", help="The 34970A with the probes.")
@click.option("--probe", "probes", multiple=True, metavar="NAME=CHANNEL", help="Such as air1=101; repeat it.")
@click.option("--thermocouple", type=click.Choice(list("BEJKNRST")), default="K", show_default=True, help="Its type.")
@click.option("--baud", type=click.IntRange(1200), default=57600, show_default=True, help="Of the multiplexer.")
@click.option("--address", type=click.IntRange(0, 255), default=1, show_default=True, help="Of the thermometer.")
@click.option("--points", type=click.IntRange(1, 20), default=1, show_default=True, help="Temperatures of the bath.")
@click.option("--reference", default=_REFERENCE, show_default=True, metavar="COLUMN", help="Of TRACE.csv.")
@click.option(
    "--window",
    "window_s",
    type=FiniteRange(min=30.0),
    default=300.0,
    show_default=True,
    help="Seconds for which it must be settled.",
)
@click.option(
    "--drift",
    "drift_K",
    type=FiniteRange(min=0.0, min_open=True),
    default=0.05,
    show_default=True,
    help="K that it may drift in them.",
)
@click.option(
    "--period",
    "period_s",
    type=FiniteRange(min=0.5),
    default=2.0,
    show_default=True,
    help="Seconds between readings.",
)
@click.option("--record", "record_path", metavar="TRACE.csv", help="Write what was read to this trace, too.")
@click.option("--simulate", is_flag=True, help="Simulated instruments in a simulated bath, 100 times as fast.")
def command(
    trace_path: str | None,
    output: str,
    thermometer: str | None,
    multiplexer: str | None,
    probes: tuple[str, ...],
    thermocouple: str,
    baud: int,
    address: int,
    points: int,
    reference: str,
    window_s: float,
    drift_K: float,
    period_s: float,
    record_path: str | None,
    simulate: bool,
) -> None:
    """Compare the multiplexer's probes with the reference thermometer in a stirred bath, and write their offsets.

    Live, with --thermometer, --multiplexer and a --probe each; or from TRACE.csv, a recorded bath, whose columns
    NAME_degC are the probes; or with --simulate. Nothing is written before the bath has settled. A campaign takes the
    file as its 'offsets'.
    """
    from ambient_trainer.laboratory.instruments.bath_run import BathRun, Pace
    from ambient_trainer.laboratory.instruments.calibration import Settled, calibrated
    from ambient_trainer.laboratory.instruments.offsets import offsets_text
    from ambient_trainer.laboratory.line import LineError
    from ambient_trainer.laboratory.simulated.bath import BATHS_DEGC, simulated_bath

    links = _Links(thermometer, multiplexer, _channels(probes), thermocouple, baud, address)
    _check_call(trace_path, links, points, record_path, simulate)
    if simulate and points > len(BATHS_DEGC):
        raise click.UsageError(f"the simulated bath goes to {len(BATHS_DEGC)} temperatures, no more")
    check_outputs([output, record_path], [trace_path] if trace_path else [])
    settled = Settled(window_s, drift_K)
    errors_K = None
    if trace_path is not None:
        windows, source = _from_trace(trace_path, reference, settled), f"{reference} in {trace_path}"
    else:
        try:
            with simulated_bath() if simulate else _real_bath(links, points) as lab:
                source, errors_K = lab.identify(), lab.errors_K
                run = BathRun(lab, Pace(period_s, _PATIENCE_S))
                try:
                    windows = [_settled(run, lab, point, points, settled) for point in range(points)]
                finally:
                    if record_path is not None:
                        _save(run.record(), record_path)
        except LineError as error:
            raise click.ClickException(str(error)) from error
    tables = calibrated(windows, trace_path or "the bath")
    with replacing(output) as stream:
        stream.write(offsets_text(tables, source, datetime.datetime.now(datetime.timezone.utc)))
    _print(tables, source, errors_K)
    click.echo(f"Offsets: {output}")


def _check_call(trace_path: str | None, links: _Links, points: int, record_path: str | None, simulate: bool) -> None:
    live = bool(links.thermometer or links.multiplexer or links.probes)
    if (trace_path is not None) + live + simulate != 1:
        raise click.UsageError(
            "take the bath from TRACE.csv, or from --thermometer, --multiplexer and --probe, or --simulate it"
        )
    if live and not (links.thermometer and links.multiplexer and links.probes):
        raise click.UsageError("live, it needs --thermometer PORT, --multiplexer PORT and a --probe NAME=CHANNEL each")
    if live and links.thermometer == links.multiplexer:
        raise click.UsageError(f"{links.thermometer} is named for both instruments: each has a port of its own")
    if trace_path is not None and record_path is not None:
        raise click.UsageError("--record is for a live bath: TRACE.csv is the record")
    if trace_path is not None and points != 1:
        raise click.UsageError("--points is for a live bath: TRACE.csv has as many as it settled at")


def _channels(probes: tuple[str, ...]) -> dict[str, int]:
    channels: dict[str, int] = {}
    for text in probes:
        name, _, channel = text.partition("=")
        if not _NAME.fullmatch(name) or not (channel.isascii() and channel.isdigit()):
            raise click.UsageError(f"--probe {text}: write it as NAME=CHANNEL, such as air1=101")
        if name in channels:
            raise click.UsageError(f"--probe {text}: {name} stands twice")
        channels[name] = int(channel)
    return channels


def _from_trace(path: str, reference: str, settled: Settled) -> list[Bath]:
    from ambient_trainer.data.trace import load_trace
    from ambient_trainer.laboratory.instruments.calibration import Bath, settled_windows

    trace = load_trace(path)
    reference_degC = trace.column(reference)
    probes = {
        name.removesuffix(_UNIT): values
        for name, values in trace.columns.items()
        if name.endswith(_UNIT) and name != reference
    }
    if not probes:
        raise refuse(path, "line 1", "no probe's column beside the reference", f"name the probes' columns NAME{_UNIT}")
    bath = Bath(trace.time_s, reference_degC, probes)
    return settled_windows(bath, settled, path)


@contextlib.contextmanager
def _real_bath(links: _Links, points: int) -> Iterator[BathLab]:
    from ambient_trainer.laboratory.clock import RealClock
    from ambient_trainer.laboratory.instruments.bath_run import BathLab
    from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer
    from ambient_trainer.laboratory.instruments.thermometer import Thermometer

    def go(point: int) -> None:
        if point:
            click.pause(f"Bring the bath to its temperature {point + 1} of {points}, and press a key.", err=True)

    clock = RealClock()
    thermometer = Thermometer(links.thermometer or "", address=links.address, clock=clock)
    multiplexer = Multiplexer(
        links.multiplexer or "", links.probes, thermocouple=links.thermocouple, clock=clock, baud=links.baud
    )
    try:
        yield BathLab(thermometer, multiplexer, tuple(links.probes), clock, go)
    finally:
        thermometer.close()
        multiplexer.close()


def _settled(run: BathRun, lab: BathLab, point: int, points: int, settled: Settled) -> Bath:
    """The window in which the bath is settled at its temperature ``point``; the terminal shows what it still lacks."""
    lab.go(point)
    with Console(stderr=True, highlight=False).status("") as status:

        def show(window: Bath, reasons: list[str]) -> None:
            lacks = "; ".join(reasons) or "settled"
            status.update(f"bath {point + 1} of {points}, {window.reference_degC[-1]:.2f} degC: {lacks}")

        return run.until_settled(settled, show)


def _save(bath: Bath, path: str) -> None:
    from ambient_trainer.data.trace import Trace, save_trace

    columns = {_REFERENCE: bath.reference_degC, **{f"{name}{_UNIT}": each for name, each in bath.probes_degC.items()}}
    save_trace(path, Trace(path, bath.time_s, columns, {"source": "calibrate"}))


def _print(tables: Mapping[str, ProbeTable], source: str, errors_K: Mapping[str, float] | None) -> None:
    rows = tuple(
        (name, f"{point.reading_degC:.2f}", f"{point.offset_K:+.4f}", f"{point.standard_error_K:.4f}")
        for name, table in tables.items()
        for point in table.points
    )
    printer().print(for_terminal(Table("", ("probe", "reads degC", "offset", "standard error"), rows)))
    click.echo(f"Offsets in K, added to what a probe reads. Reference: {source}; its own error is not in them.")
    if errors_K is not None:
        misses = [abs(point.offset_K + errors_K[name]) for name, table in tables.items() for point in table.points]
        click.echo(f"The simulated probes' errors are known: the worst offset misses its by {max(misses):.4f} K.")
