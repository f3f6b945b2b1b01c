"""``ambient-trainer simulate``: the trace of a simulated phone in a scenario of the thesis; effects may hide in it."""

from __future__ import annotations

from functools import partial

import click

from ambient_model.faults import Refused
from ambient_trainer.cli.options import sampling_option, seed_option
from ambient_trainer.cli.output import check_outputs
from ambient_trainer.cli.progress import staged_progress
from ambient_trainer.report.machine import write_json
from ambient_trainer.simulator.scenario import load_scenario, scenario_names


@click.command("simulate")
@click.argument("scenario", type=click.Choice(scenario_names()), metavar="SCENARIO")
@seed_option("Another one, another noise.")
@sampling_option("Seconds between samples.", longest_s=60)
@click.option("--zones", is_flag=True, help="All of the phone's zones, about 50, not only the thesis's five sensors.")
@click.option("--hide", "texts", multiple=True, metavar="EFFECT", help="Hide this in it; may stand several times.")
@click.option(
    "--decoy", "decoys", multiple=True, metavar="COLUMN", help="Log this signal, which changes no temperature."
)
@click.option("--truth", "truth_path", metavar="FILE.json", help="Write what is hidden to this file.")
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False), help="The trace; .gz compresses it.")
def command(
    scenario: str,
    seed: int,
    period_s: float,
    zones: bool,
    texts: tuple[str, ...],
    decoys: tuple[str, ...],
    truth_path: str | None,
    output: str,
) -> None:
    """Write what a simulated phone would log in SCENARIO: 1, 2.1 to 2.5, 3, 4 or 5 of the thesis.

    The same SCENARIO, seed, period and effects give the same file.

    EFFECT is CAUSE[:PLACE][:SIZE][:KEY=VALUE]..., or random. What it leaves out is drawn from the seed; but a signal
    only where neither size nor times are given. Examples:

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
    """
    from ambient_trainer.data.trace import save_trace
    from ambient_trainer.simulator.effects.runs import simulate_hidden  # scipy: --help should not wait for it
    from ambient_trainer.simulator.effects.text import hidden_text, parse_hidden
    from ambient_trainer.simulator.zones import all_zones, thesis_zones

    check_outputs([output, truth_path], [])
    try:
        effects = parse_hidden(texts, seed, load_scenario(scenario).duration_s)
        runs = [(scenario, seed, effects)]
        wanted = all_zones() if zones else thesis_zones()
        with staged_progress() as progress:
            show = partial(progress, f"scenario {scenario}")
            simulated = simulate_hidden(runs, period_s, decoys, truth_path is not None, show, wanted)[0]
    except Refused as refused:
        raise click.UsageError(str(refused)) from refused
    save_trace(output, simulated.trace)
    count = f"{len(simulated.trace.time_s)} simulated samples, one every {period_s:g} s"
    hidden = f", with {len(effects)} hidden effect{'s' * (len(effects) > 1)}" if effects else ""
    click.echo(f"wrote {output}: {count}{hidden}")
    if truth_path is not None:
        told = [{"hidden": hidden_text(each), **truth.as_data()} for each, truth in zip(effects, simulated.truths)]
        write_json(truth_path, {"effects": told})
        click.echo(f"wrote {truth_path}: what is hidden in it")
