"""Progress of a laboratory run: a live picture on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ambient_trainer.laboratory.collect import Job
from ambient_trainer.laboratory.report import degrees_text, expected
from ambient_trainer.laboratory.run import CampaignRun
from ambient_trainer.report.words import clock

_REDRAW_S = 0.25
_LINE_S = 60.0
"""Of the run's time, and of the machine's no more often than:"""
_LINE_WALL_S = 2.0


@contextlib.contextmanager
def monitor_of(console: Console, job: Job) -> Iterator[ConsoleMonitor]:
    """The monitor for a terminal, or for anything else that ``console`` writes to."""
    simulated = f", simulated at {job.speed:g} times real time" if job.simulated else ""
    live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
    with live or contextlib.nullcontext():
        yield ConsoleMonitor(console, live, f"{job.loaded.name}{simulated}")


class ConsoleMonitor:
    """Events, and the state of the run: a ``live`` picture, or else a line a minute."""

    def __init__(self, console: Console, live: Live | None, title: str) -> None:
        self._console, self._live, self._title = console, live, title
        self._due_s = self._due_wall_s = 0.0

    def update(self, run: CampaignRun) -> None:
        """Draw the picture anew, or print a line, where that is due."""
        now_s, wall_s = run.clock.now_s(), time.monotonic()
        if wall_s < self._due_wall_s or (self._live is None and now_s < self._due_s):
            return
        self._due_s, self._due_wall_s = now_s + _LINE_S, wall_s + (_REDRAW_S if self._live else _LINE_WALL_S)
        if self._live:
            self._live.update(self._picture(run), refresh=True)
        else:
            ambient = "-" if run.ambient_degC is None else f"{run.ambient_degC:.2f}"
            self.event(now_s, f"{_step_text(run)}, ambient {ambient} degC, {_left_text(run)}")

    def event(self, at_s: float, text: str) -> None:
        """Print it with its time; above the picture, where it stays."""
        self._console.print(f"{clock(at_s)}  {text}", markup=False, highlight=False, soft_wrap=True)

    def _picture(self, run: CampaignRun) -> Group:
        now_s = run.clock.now_s()
        readings = Table("", "", "s ago", box=None, pad_edge=False)
        for column in readings.columns[1:]:
            column.justify = "right"
        readings.add_row("ambient_degC", "-" if run.ambient_degC is None else f"{run.ambient_degC:.3f}", "")
        for sample in run.latest.values():
            for name, value in sample.values.items():
                readings.add_row(Text(name), "-" if value is None else f"{value:g}", f"{now_s - sample.at_s:.0f}")
        left = f"{clock(now_s)} since the beginning, {_left_text(run)}"
        parts: list[RenderableType] = [Text(f"{self._title}: {_step_text(run)}", style="bold"), Text(left), readings]
        parts += [Text(f"! {each.text}", style="red") for each in run.failures.values()]
        if run.alarm is not None:
            parts.append(Text(f"! the chamber is stopped: {run.alarm}", style="bold red"))
        return Group(*parts)


def _left_text(run: CampaignRun) -> str:
    """The run's time that the program should still take, and what is safe on the disk."""
    steps, program = expected(run.campaign), run.program
    left_s = 0.0
    if not program.over:
        left_s = max(steps[program.step].length_s - (run.clock.now_s() - program.began_s), 0.0)
        left_s += sum(each.length_s for each in steps[program.step + 1 :])
    return f"{clock(left_s)} left, {run.journal.samples_on_disk} samples on disk"


def _step_text(run: CampaignRun) -> str:
    program, campaign = run.program, run.campaign
    if program.over:
        return "the program is over"
    count, step = len(campaign.before), program.step
    recording = f"step {step - count + 1} of {len(campaign.steps)}"
    place = f"before the recording {step + 1} of {count}" if step < count else recording
    load = f", {' and '.join(program.now.load)}" if program.now.load else ""
    return f"{place}: {degrees_text(program.now.chamber_degC)} degC{load}"
