"""``ambient-trainer simulate``: the trace of a simulated device in a scenario; effects may be hidden in it."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

from ambient_model.faults import Refused
from ambient_trainer.cli.options import sampling_option, seed_option
from ambient_trainer.cli.output import check_outputs
from ambient_trainer.cli.progress import staged_progress
from ambient_trainer.report.machine import write_json


@click.command("simulate")
@click.argument("scenario")
@click.option(
    "--device", default="phone", show_default=True, metavar="NAME|FILE.yaml", help="phone, set_top_box, or a file."
)
@seed_option("Another one, another noise.")
@sampling_option("Seconds between samples.", longest_s=60)
@click.option("--zones", "all_zones", is_flag=True, help="All of the device's zones, not only its main sensors.")
@click.option("--hide", multiple=True, metavar="EFFECT", help="Hide this in it; may stand several times.")
@click.option(
    "--decoy", "decoys", multiple=True, metavar="COLUMN", help="Log this signal, which changes no temperature."
)
@click.option("--truth", "truth_path", metavar="FILE.json", help="Write what is hidden to this file.")
@click.option("-o", "--output", required=True, type=click.Path(dir_okay=False), help="The trace; .gz compresses it.")
def command(
    scenario: str,
    device: str,
    seed: int,
    period_s: float,
    hide: tuple[str, ...],
    truth_path: str | None,
    output: str,
    **logged: Any,
) -> None:
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
    """
    from ambient_trainer.data.trace import save_trace
    from ambient_trainer.simulator import simulate  # scipy: --help should not wait for it
    from ambient_trainer.simulator.text import hidden_text

    check_outputs([output, truth_path], [])
    try:
        with staged_progress() as progress:
            logged |= {"sizes": truth_path is not None, "progress": partial(progress, f"scenario {scenario}")}
            simulated = simulate(scenario, device, seed, period_s, hide, **logged)
    except Refused as refused:
        raise click.UsageError(str(refused)) from refused
    save_trace(output, simulated.trace)
    count = f"{len(simulated.trace.time_s)} simulated samples, one every {period_s:g} s"
    number = len(simulated.hidden)
    hidden = f", with {number} hidden effect{'s' * (number > 1)}" if number else ""
    click.echo(f"wrote {output}: {count}{hidden}")
    if truth_path is not None:
        effects = [
            {"hidden": hidden_text(each), **truth.as_data()} for each, truth in zip(simulated.hidden, simulated.truths)
        ]
        write_json(truth_path, {"effects": effects})
        click.echo(f"wrote {truth_path}: what is hidden in it")
