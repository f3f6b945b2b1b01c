"""``ambient-trainer calibrate``: the probes' offsets from a reference thermometer in the same bath."""

import datetime
import re
import time

import click
from rich.console import Console

from ambient_model.atomic import replacing
from ambient_trainer import cli

_KINDS = {"thermometer": "greisinger-easybus", "multiplexer": "agilent-34970a"}
_SIMULATED_PROBES = {"air1": 101, "air2": 102, "air3": 103, "air4": 104}
_PROBE = re.compile(r"([A-Za-z][A-Za-z0-9_.-]*)=([0-9]+)")
_PATIENCE_S = 3600.0
_LINE_S = 30.0
"""Between two lines of what it waits for, where there is no terminal."""
_WINDOW, _PERIOD, _DRIFT = cli.FiniteRange(30.0), cli.FiniteRange(0.5), cli.FiniteRange(0.0, min_open=True)


def _channels(context: click.Context, parameter: click.Parameter, texts: tuple[str, ...]) -> dict[str, int]:
    channels: dict[str, int] = {}
    for text in texts:
        if (probe := _PROBE.fullmatch(text)) is None:
            raise click.UsageError(f"--probe {text}: write it as NAME=CHANNEL, such as air1=101")
        name, channel = probe.groups()
        if name in channels:
            raise click.UsageError(f"--probe {text}: {name} is given twice")
        channels[name] = int(channel)
    return channels


@click.command("calibrate")
@click.argument("trace_path", metavar="[TRACE.csv]", required=False)
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False), help="The offsets, as YAML.")
@click.option("--thermometer", metavar="PORT", help="The reference, a Greisinger GMH.")
@click.option("--multiplexer", metavar="PORT", help="The 34970A with the probes.")
@click.option(
    "--probe", "probes", multiple=True, callback=_channels, metavar="NAME=CHANNEL", help="Such as air1=101; repeat it."
)
@click.option("--thermocouple", type=click.Choice(list("BEJKNRST")), default="K", help="Its type.")
@click.option("--baud", type=click.IntRange(1200), default=57600, help="Of the multiplexer.")
@click.option("--address", type=click.IntRange(0, 255), default=1, help="Of the thermometer.")
@click.option("--points", type=click.IntRange(1, 20), default=1, help="Temperatures of the bath.")
@click.option("--reference", default="bath_degC", metavar="COLUMN", help="Of TRACE.csv.")
@click.option("--window", "window_s", type=_WINDOW, default=300.0, help="Seconds for which it must be settled.")
@click.option("--drift", "drift_K", type=_DRIFT, default=0.05, help="K that it may drift in them.")
@click.option("--period", "period_s", type=_PERIOD, default=2.0, help="Seconds between readings.")
@click.option("--record", "record_path", metavar="TRACE.csv", help="Write what was read to this trace, too.")
@click.option("--simulate", is_flag=True, help="Simulated instruments in a simulated bath, 100 times as fast.")
def command(
    trace_path: str | None,
    output: str,
    thermometer: str | None,
    multiplexer: str | None,
    probes: dict[str, int],
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
    from ambient_trainer.data.probe_offsets import offsets_text
    from ambient_trainer.evaluation.bath import Settled, calibrated, load_bath, settled_windows
    from ambient_trainer.laboratory.calibration import BATHS_DEGC, bath, report_of
    from ambient_trainer.laboratory.instruments import settings
    from ambient_trainer.laboratory.messages import InstrumentError

    live = bool(thermometer or multiplexer or probes)
    readings = int(window_s / period_s) + 1
    wrong = {
        "take the bath from TRACE.csv, or from --thermometer, --multiplexer and --probe, or --simulate it": (
            (trace_path is not None) + live + simulate != 1
        ),
        "live, it needs --thermometer PORT, --multiplexer PORT and a --probe NAME=CHANNEL each": (
            live and not (thermometer and multiplexer and probes)
        ),
        f"{thermometer} is named for both instruments: each has a port of its own": live and thermometer == multiplexer,
        "--record is for a live bath: TRACE.csv is the record": trace_path is not None and record_path is not None,
        "--points is for a live bath: TRACE.csv has as many as it settled at": trace_path is not None and points != 1,
        f"{window_s:g} s have {readings} readings, and to settle needs {Settled.samples}: take --window "
        f"{(Settled.samples - 1) * period_s:g} or more, or a shorter --period than {period_s:g}": (
            trace_path is None and readings < Settled.samples
        ),
        f"the simulated bath goes to {len(BATHS_DEGC)} temperatures, no more": simulate and points > len(BATHS_DEGC),
    }
    for message, is_so in wrong.items():
        if is_so:
            raise click.UsageError(message)
    cli.Output().check([trace_path] if trace_path else [], [output, record_path])
    settled = Settled(window_s, drift_K)
    errors_K = None
    if trace_path is not None:
        source = f"{reference} in {trace_path}"
        windows = settled_windows(load_bath(trace_path, reference), settled, trace_path)
    else:
        named = {"thermocouple": thermocouple, "baud": baud, "probes": probes or _SIMULATED_PROBES}
        links = (
            settings(_KINDS["thermometer"], port=thermometer or "", address=address),
            settings(_KINDS["multiplexer"], port=multiplexer or "", **named),
        )
        status = Console(stderr=True, highlight=False).status("")
        due_s = time.monotonic()

        def show(text: str) -> None:
            nonlocal due_s
            status.update(text)
            if not status.console.is_terminal and time.monotonic() >= due_s:
                due_s = time.monotonic() + _LINE_S
                click.echo(text, err=True)

        def go_to(point: int) -> None:
            if point:
                status.stop()
                click.pause(f"Bring the bath to its temperature {point + 1} of {points}, and press a key.", err=True)
                status.start()

        try:
            with bath(*links, period_s, _PATIENCE_S, None if simulate else go_to) as there, status:
                source, errors_K = there.identify(), there.errors_K
                windows = there.windows(points, settled, show, record_path)
        except InstrumentError as error:
            raise click.ClickException(str(error)) from error
    offsets = calibrated(windows, trace_path or "the bath")
    with replacing(output) as stream:
        stream.write(offsets_text(offsets, source, datetime.datetime.now(datetime.timezone.utc)))
    cli.Output().show(report_of(offsets, output, source, errors_K))
