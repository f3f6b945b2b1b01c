"""``ambient-trainer mitigate``: what the estimate is worth to a governor, in closed loop on a simulated phone."""

from __future__ import annotations

import click

from ambient_model.codec import load_model
from ambient_studies.mitigation.comparison import Comparison, compare, settling_min
from ambient_studies.mitigation.room import room_of
from ambient_studies.mitigation.score import as_json, fixed_trip, score_table, scores, verdict
from ambient_studies.mitigation.setting import Outage, Setting
from ambient_studies.mitigation.training import SCENARIO
from ambient_trainer.cli.number import Finite, FiniteRange, sampling_option
from ambient_trainer.cli.outputs import check_outputs
from ambient_trainer.cli.printing import printer, write_figures, write_page
from ambient_trainer.cli.progress import staged_progress
from ambient_trainer.report.table import for_terminal

_WORKLOADS = ("cpu_100", "cpu_50", "camera_1080p", "camera_4k", "streaming")
_ROOMS = ("5", "20", "35", "35/5/35")


@click.command("mitigate")
@click.argument("model_path", metavar="MODEL.json")
@click.option(
    "--room",
    "rooms",
    multiple=True,
    metavar="T[/T...]",
    default=_ROOMS,
    show_default=True,
    help="Air in degC; 35/5/35 walks out into the cold and back. Repeat it.",
)
@click.option(
    "--limit",
    "limit_degC",
    type=FiniteRange(20, 60),
    default=40.0,
    show_default=True,
    help="What the skin shall not pass, degC.",
)
@click.option(
    "--hottest",
    "hottest_degC",
    type=FiniteRange(-20, 60),
    default=35.0,
    show_default=True,
    help="The hottest room to be safe in, degC.",
)
@click.option(
    "--usual",
    "usual_degC",
    type=FiniteRange(-20, 60),
    default=20.0,
    show_default=True,
    help="What else may be assumed, degC.",
)
@click.option("--sensor", default="soc", show_default=True, metavar="ZONE", help="The zone that the governor acts on.")
@click.option(
    "--workload", type=click.Choice(_WORKLOADS), default=_WORKLOADS[0], show_default=True, help="What the phone does."
)
@click.option("--minutes", "work_min", type=FiniteRange(1, 1440), default=60.0, show_default=True, help="For how long.")
@click.option(
    "--idle", "idle_min", type=FiniteRange(0, 1440), metavar="MIN", help="Before it; default: till MODEL settles."
)
@click.option(
    "--seed", type=click.IntRange(min=1), default=1, show_default=True, help="The first run's; training has 0."
)
@click.option("--runs", type=click.IntRange(1, 50), default=3, show_default=True, help="How many seeds a room.")
@sampling_option("Between a governor's decisions.")
@click.option(
    "--convection",
    type=FiniteRange(0.5, 50),
    metavar="X",
    help="Of the rooms' air, in W/(m2 K^1.25); 2.8 is still.",
)
@click.option(
    "--lose",
    type=(str, Finite(), Finite()),
    metavar="SENSOR FROM TO",
    help="That sensor is silent between these minutes.",
)
@click.option("--json", "json_path", metavar="OUT", help="Write the figures to this file as JSON.")
@click.option("--report", "report_folder", metavar="DIR", help="Write a page with plots into this folder.")
def command(
    model_path: str,
    rooms: tuple[str, ...],
    limit_degC: float,
    hottest_degC: float,
    usual_degC: float,
    sensor: str,
    workload: str,
    work_min: float,
    idle_min: float | None,
    seed: int,
    runs: int,
    period_s: float,
    convection: float | None,
    lose: tuple[str, float, float] | None,
    json_path: str | None,
    report_folder: str | None,
) -> None:
    """Let one governor cap a simulated phone's processor in several rooms: with the estimate of MODEL.json, without it
    (an assumed ambient in its place), and with the truth.

    What the governor knows of the phone is identified on a training run in the chamber; so must MODEL.json be. Every
    figure is simulated.
    """
    if limit_degC <= hottest_degC:
        raise click.UsageError(
            f"--limit {limit_degC:g} is no warmer than --hottest {hottest_degC:g}: nothing holds that"
        )
    if lose is not None and not lose[1] < lose[2]:
        raise click.UsageError(f"--lose {lose[0]} {lose[1]:g} {lose[2]:g} ends before it begins")
    check_outputs([json_path], [model_path], report_folder)
    model = load_model(model_path)
    setting = Setting(
        limit_degC=limit_degC,
        hottest_degC=hottest_degC,
        usual_degC=usual_degC,
        workload=workload,
        work_min=work_min,
        idle_min=settling_min(model, period_s) if idle_min is None else idle_min,
        period_s=period_s,
        convection_W_m2_K125=convection,
        outage=None if lose is None else Outage(*lose),
    )
    ways = [room_of(text) for text in dict.fromkeys(rooms)]
    with staged_progress() as progress:
        comparison = compare(model, sensor, setting, ways, range(seed, seed + runs), progress)
        progress("drawing the report", 0, 1)
        page = _page(comparison) if report_folder else ""
    _show(comparison)
    if json_path is not None:
        write_figures(json_path, as_json(comparison))
    if report_folder is not None:
        write_page(report_folder, page)


def _page(comparison: Comparison) -> str:
    # plotly takes half a second to import: only a report should wait for it
    from ambient_studies.mitigation.page import mitigation_page

    return mitigation_page(comparison)


def _show(comparison: Comparison) -> None:
    setting, identified = comparison.setting, comparison.identified
    found = scores(comparison.records, setting)
    click.echo(f"Governor on {identified.sensor}, identified on scenario {SCENARIO}: {identified}.")
    click.echo(f"{fixed_trip(comparison)}.")
    printer().print(for_terminal(score_table(found, setting)))
    for line in verdict(found, setting):
        click.echo(line)
