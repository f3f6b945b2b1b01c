"""``ambient-trainer mitigate``: the estimate's benefit to a governor, in closed loop on a simulated phone."""

from typing import Any

import click

from ambient_trainer.cli import Finite, FiniteRange, Output, output_options, sampling_option, staged_progress

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
    help="Air in degC; 35/5/35 walks out into the cold and back. Repeatable.",
)
@click.option(
    "--limit",
    "limit_degC",
    type=FiniteRange(20, 60),
    default=40.0,
    help="The highest permitted skin temperature, degC.",
)
@click.option(
    "--hottest",
    "hottest_degC",
    type=FiniteRange(-20, 60),
    default=35.0,
    help="The hottest room that the phone is made for, degC.",
)
@click.option("--usual", "usual_degC", type=FiniteRange(-20, 60), default=20.0, help="The other assumed ambient, degC.")
@click.option("--sensor", default="soc", metavar="ZONE", help="The zone that the governor acts on.")
@click.option("--workload", type=click.Choice(_WORKLOADS), default=_WORKLOADS[0], help="The phone's load.")
@click.option("--minutes", "work_min", type=FiniteRange(1, 1440), default=60.0, help="Its duration.")
@click.option(
    "--idle",
    "idle_min",
    type=FiniteRange(0, 1440),
    metavar="MIN",
    show_default="MODEL's settling time",
    help="Idle time before it.",
)
@click.option("--seed", type=click.IntRange(min=1), default=1, help="The first run's; training has 0.")
@click.option("--runs", type=click.IntRange(1, 50), default=3, help="How many seeds a room.")
@sampling_option("Of the governor.")
@click.option(
    "--convection",
    "convection_W_m2_K125",
    type=FiniteRange(0.5, 50),
    metavar="X",
    help="Of the rooms' air, in W/(m2 K^1.25); 2.8 is still.",
)
@click.option(
    "--lose",
    type=(str, Finite(), Finite()),
    metavar="SENSOR FROM TO",
    help="This sensor has no readings between these minutes.",
)
@output_options(page=True)
def command(
    model_path: str,
    rooms: tuple[str, ...],
    sensor: str,
    seed: int,
    runs: int,
    lose: tuple[str, float, float] | None,
    output: Output,
    **setting: Any,
) -> None:
    """Cap a simulated phone's processor by one governor in several rooms: with the estimate of MODEL.json, without it
    (an assumed ambient in its place), and with the truth.

    The governor is identified on a training run in the chamber; fit MODEL.json to the chamber, too. Every figure is
    simulated.
    """
    from ambient_model.codec import load_model
    from ambient_studies.mitigation.comparison import compare, settling_min
    from ambient_studies.mitigation.report import report_of  # scipy: --help should not wait for it
    from ambient_studies.mitigation.setting import Outage, Setting, room_of

    limit_degC, hottest_degC, idle_min = (setting[name] for name in ("limit_degC", "hottest_degC", "idle_min"))
    if limit_degC <= hottest_degC:
        raise click.UsageError(f"--limit {limit_degC:g} is not above --hottest {hottest_degC:g}: raise --limit")
    if lose is not None and not lose[1] < lose[2]:
        raise click.UsageError(f"--lose {lose[0]} {lose[1]:g} {lose[2]:g} ends before it begins")
    output.check([model_path])
    model = load_model(model_path)
    setting["idle_min"] = settling_min(model, setting["period_s"]) if idle_min is None else idle_min
    same = Setting(**setting, outage=None if lose is None else Outage(*lose))
    chosen = [room_of(text) for text in dict.fromkeys(rooms)]
    with staged_progress() as progress:
        comparison = compare(model, sensor, same, chosen, range(seed, seed + runs), progress)
    output.show(report_of(comparison))
