"""``ambient-trainer simulate``: the trace of a simulated device in a scenario; effects may be hidden in it."""

import os
from functools import partial
from typing import Any

import click

import ambient_trainer as at
from ambient_trainer import cli
from ambient_trainer.report.files import write_json

_MINUTES = cli.FiniteRange(min=1)


@click.command("simulate")
@click.argument("scenario")
@click.option("--device", default="phone", metavar="NAME|FILE.yaml", help="phone, set_top_box, or a file.")
@cli.seed_option("Of the noise and of what is drawn.")
@cli.sampling_option("Seconds between samples.", longest_s=60)
@click.option("--zones", "all_zones", is_flag=True, help="All of the device's zones, not only its main sensors.")
@click.option("--hide", multiple=True, metavar="EFFECT", help="Hide this in it; may stand several times.")
@click.option(
    "--decoy", "decoys", multiple=True, metavar="COLUMN", help="Log this signal, which changes no temperature."
)
@click.option("--truth", "truth_path", metavar="FILE.json", help="Write what is hidden to this file.")
@click.option("--units", type=click.IntRange(2, 1_000_000), metavar="N", help="Draw a fleet of so many units.")
@click.option("--minutes", type=_MINUTES, metavar="M", show_default="as long as SCENARIO", help="Of each unit's log.")
@click.option("--cased", type=cli.FiniteRange(0, 1), default=0.5, metavar="SHARE", help="Of the units, in a case.")
@click.option(
    "-o", "--output", required=True, metavar="OUT", help="The trace (.gz compresses it), or a fleet's folder."
)
def command(scenario: str, truth_path: str | None, output: str, units: int | None, **of: Any) -> None:
    """Write what a simulated device logs in SCENARIO.

    SCENARIO is 1, 2.1 to 2.5, 3, 4 or 5 of the thesis (a phone's), set_top_box, or a FILE.yaml, such as a campaign of
    the laboratory.

    The same SCENARIO, device, seed, period and effects give the same file.

    EFFECT is CAUSE[:PLACE][:SIZE][:KEY=VALUE]..., or random. What it leaves out is drawn from the seed; but a signal
    only where neither size nor times are given. Examples, on the phone:

    \b
    heat_source:board2:0.8W:from=2h:to=3h    heat_source:soc:signal=radio_on
    ambient_coupling:all:-40%:from=90min     contact:back:0.1W/K:body=hand
    thermal_mass:display:120J/K              path:flash-usb:0.1W/K
    sensor_drift:usb:0.5K/h                  clock_offset:all:90s

    \b
    CAUSE  heat_source ambient_coupling contact convection_law thermal_mass path
           sensor_bias sensor_gain sensor_lag sensor_stuck sensor_drift clock_offset
    PLACE  a node, two as a-b, a sensor, or all
    KEY    from, to (s, min, h; to=end), signal (or none), body, scale of what is drawn

    The trace does not say what is hidden in it; --truth does, in the terms of a diagnosis.

    With --units, OUT is a folder: a Parquet dataset of units within the device's tolerances. Each begins SCENARIO at a
    step of its own; each EFFECT is hidden in one of them. That needs ambientd[fleet].
    """
    drawn = {name: of.pop(name) for name in ("minutes", "cased")}
    if units is not None:
        if of["all_zones"] or of["decoys"]:
            raise click.UsageError("--units logs each unit's main sensors: leave out --zones and --decoy")
        for name in ("all_zones", "decoys"):
            of.pop(name)
        return _fleet(output, truth_path, {"scenario": scenario, "count": units, **drawn, **of})
    if drawn["minutes"] is not None:
        raise click.UsageError("--minutes is for --units: cut a trace with --from and --to where it is read")
    if os.path.isdir(output):
        raise click.UsageError(f"{output} is a folder: name a file, or draw a fleet with --units")
    cli.Output().check([], [output, truth_path])
    of["sizes"] = truth_path is not None
    try:
        with cli.staged_progress() as progress:
            result = at.simulate(scenario, **of, progress=partial(progress, f"scenario {scenario}"))
    except at.Refused as refused:
        raise click.UsageError(str(refused)) from refused
    result.save(output)
    number = len(result.truth)
    hidden = f", with {number} hidden effect{'s' * (number > 1)}" if number else ""
    click.echo(f"wrote {output}: {len(result.trace)} simulated samples, one every {of['period_s']:g} s{hidden}")
    if truth_path is not None:
        write_json(truth_path, result.summary.data)
        click.echo(f"wrote {truth_path}: what is hidden in it")


def _fleet(folder: str, truth_path: str | None, plan: dict[str, Any]) -> None:
    from ambient_trainer.fleet.dataset import write_dataset
    from ambient_trainer.simulator.fleet import FleetPlan, FleetUnit, fleet

    cli.Output().check([], [truth_path], folder)
    truths = []

    def written(unit: FleetUnit) -> tuple[str, Any, dict[str, str]]:
        truths.append(unit.truth)
        return unit.name, unit.trace, {"case": unit.case}

    try:
        with cli.staged_progress() as progress:
            what = partial(progress, f"{plan['count']} units")
            count = write_dataset(folder, map(written, fleet(FleetPlan(**plan), what)))
    except at.Refused as refused:
        raise click.UsageError(str(refused)) from refused
    click.echo(f"wrote {folder}: {count} simulated units, one sample every {plan['period_s']:g} s")
    if truth_path is not None:
        write_json(truth_path, {"units": truths})
        click.echo(f"wrote {truth_path}: what they are")
