"""``ambient-trainer search``: which sensors, how many, and which circuit, by the error on blocks that no fit saw."""

from dataclasses import asdict
from typing import Any

import click

from ambient_model import __version__
from ambient_trainer import cli
from ambient_trainer.report.files import made_folder

_GAP, _ERROR = cli.FiniteRange(min=0), cli.FiniteRange(min=1e-3, max=10)


@click.command("search")
@click.argument("trace_paths", metavar="TRACE...", nargs=-1, required=True)
@click.option("--most", type=click.IntRange(1, 12), default=6, help="Up to so many sensors.")
@click.option("--order", type=click.IntRange(1, 4), default=4, help="States of a filter or circuit.")
@click.option("--blocks", type=click.IntRange(2, 1000), default=10, help="Held out in turn.")
@click.option("--gap", "gap_s", type=_GAP, metavar="S", show_default="a tenth of it", help="Beside a block.")
@click.option(
    "--tolerance", "tolerance_degC", type=_ERROR, default=0.1, help="Error of each sensor, as noise and as a bias."
)
@click.option(
    "--against", type=cli.names, metavar="A,B,...", help="Score this set beside the best, such as usb,battery."
)
@click.option(
    "--check", "check_paths", metavar="TRACE", multiple=True, help="Score on this, too; nothing is chosen by it."
)
@click.option("--circuits", "circuit_folder", metavar="DIR", help="Write the best circuit of each size to this folder.")
@click.option("--no-circuits", is_flag=True, help="Search for sensors only.")
@cli.window_options
@cli.period_option()
@cli.output_options(page=True)
@click.option("--state", "state_path", metavar="FILE", help="Keep what is done here, and go on from it.")
@cli.jobs_option("Processes.")
def command(
    trace_paths: tuple[str, ...],
    against: tuple[str, ...] | None,
    check_paths: tuple[str, ...],
    circuit_folder: str | None,
    no_circuits: bool,
    from_s: float | None,
    to_s: float | None,
    output: cli.Output,
    state_path: str | None,
    jobs: int,
    **options: Any,
) -> None:
    """Search the temperatures of one or several TRACEs for those that estimate ambient_degC best, one to --most.

    A zone that is dead, constant, stuck or a double is left out, with the reason. With --state, Ctrl-C loses nothing:
    the same command goes on where it stopped.
    """
    from ambient_trainer.circuits import save_circuit  # scipy: --help should not wait for it
    from ambient_trainer.data.trace import load_trace, sha256_of
    from ambient_trainer.selection.report import left_out_lines, report_of
    from ambient_trainer.selection.resumable import ResumablePool
    from ambient_trainer.selection.screen import screened
    from ambient_trainer.selection.search import Options, prepared, searched

    if no_circuits and circuit_folder is not None:
        raise click.UsageError("--circuits asks for what --no-circuits leaves out: give one of them")
    chosen = Options(**options)
    output.check([*trace_paths, *check_paths], [state_path], circuit_folder)
    traces = [load_trace(path).cut(from_s, to_s) for path in trace_paths]
    digests = [sha256_of(path) for path in trace_paths]
    if seen := [path for path in check_paths if sha256_of(path) in digests]:
        raise click.UsageError(f"{seen[0]} is searched, too: check on another trace")
    sensors, left_out = screened(traces)
    for line in left_out_lines(left_out):
        click.echo(line)
    data = prepared(traces, sensors, left_out, chosen)
    checks = [load_trace(path) for path in check_paths]
    # what results depend on: who computes them, the data's bytes and the options
    identity = {"made_by": __version__, "traces": digests, "from_s": from_s, "to_s": to_s, **asdict(chosen)}
    try:
        with cli.counted_progress() as progress, ResumablePool(jobs, state_path, identity, progress) as pool:
            compared = [name.removesuffix("_degC") for name in against or ()]
            result = searched(data, pool, compared, checks, not no_circuits)
    except KeyboardInterrupt:
        kept = f"what is done is kept in {state_path}: the same command goes on from there"
        lost = "nothing was kept: with --state FILE the next one could go on from there"
        raise click.ClickException(f"stopped; {kept if state_path else lost}") from None
    output.show(report_of(result))
    if circuit_folder is not None:
        place = made_folder(circuit_folder)
        for each in result.circuits.values():
            path = str(place / f"{each.circuit.name}.yaml")
            save_circuit(path, each.circuit)
            click.echo(f"Circuit: {path}")
