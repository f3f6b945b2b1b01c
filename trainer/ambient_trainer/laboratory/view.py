"""What is to be seen while a run lasts: on a terminal a picture that is kept up, elsewhere a line now and then."""

from __future__ import annotations

import time

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ambient_trainer.laboratory.conductor import Conductor
from ambient_trainer.laboratory.schedule import clock_text, expected

_REDRAW_S = 0.25
_LINE_S = 60.0
"""Of the run's time, and of the machine's no more often than:"""
_LINE_WALL_S = 2.0
_LAST_WORDS = 8


def left_s(conductor: Conductor) -> float:
    """The run's time that the program should still take."""
    program = conductor.program
    if program.over:
        return 0.0
    steps = expected(conductor.bench.campaign)
    now_s = conductor.timebase.now_s()
    return max(steps[program.step].length_s - (now_s - program.began_s), 0.0) + sum(
        each.length_s for each in steps[program.step + 1 :]
    )


class PlainEyes:
    """A line a minute, and one for all that happens."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._due_s = 0.0
        self._due_wall_s = 0.0

    def look(self, conductor: Conductor) -> None:
        """Print a line where one is due."""
        now_s, wall_s = conductor.timebase.now_s(), time.monotonic()
        if now_s < self._due_s or wall_s < self._due_wall_s:
            return
        self._due_s, self._due_wall_s = now_s + _LINE_S, wall_s + _LINE_WALL_S
        ambient = "-" if conductor.ambient_degC is None else f"{conductor.ambient_degC:.2f}"
        self.say(
            now_s,
            f"{_step_text(conductor)}, ambient {ambient} degC, {clock_text(left_s(conductor))} left, "
            f"{conductor.journal.samples_on_disk} samples on disk",
        )

    def say(self, at_s: float, text: str) -> None:
        """Print it with its time."""
        self._console.print(f"{clock_text(at_s)}  {text}", markup=False, highlight=False, soft_wrap=True)


class LiveEyes:
    """A picture on a terminal; used as a ``with`` block."""

    def __init__(self, console: Console, title: str) -> None:
        self._title = title
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._due_wall_s = 0.0
        self._said: list[str] = []

    def __enter__(self) -> LiveEyes:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def look(self, conductor: Conductor) -> None:
        """Draw it anew where that is due."""
        wall_s = time.monotonic()
        if wall_s >= self._due_wall_s:
            self._due_wall_s = wall_s + _REDRAW_S
            self._live.update(self._picture(conductor), refresh=True)

    def say(self, at_s: float, text: str) -> None:
        """Print it above the picture, where it stays."""
        line = Text(f"{clock_text(at_s)}  {text}")
        self._live.console.print(line)

    def _picture(self, conductor: Conductor) -> Group:
        now_s = conductor.timebase.now_s()
        head = Text(f"{self._title}: {_step_text(conductor)}", style="bold")
        times = Text(
            f"{clock_text(now_s)} since the beginning, {clock_text(left_s(conductor))} left, "
            f"{conductor.journal.samples_on_disk} samples on disk"
        )
        parts: list[RenderableType] = [head, times, _readings(conductor, now_s)]
        parts += [Text(f"! {each.text}", style="red") for each in conductor.troubles.values()]
        if conductor.alarm is not None:
            parts.append(Text(f"! the chamber is stopped: {conductor.alarm}", style="bold red"))
        return Group(*parts)


def _readings(conductor: Conductor, now_s: float) -> Table:
    table = Table(box=None, pad_edge=False)
    for name in ("", "", "s ago"):
        table.add_column(name, justify="left" if table.columns == [] else "right")
    ambient = "-" if conductor.ambient_degC is None else f"{conductor.ambient_degC:.3f}"
    table.add_row("ambient_degC", ambient, "")
    for sample in conductor.latest.values():
        for name, value in sample.values.items():
            table.add_row(Text(name), "-" if value is None else f"{value:g}", f"{now_s - sample.at_s:.0f}")
    return table


def _step_text(conductor: Conductor) -> str:
    program, campaign = conductor.program, conductor.bench.campaign
    if program.over:
        return "the program is over"
    before = len(campaign.before)
    place = (
        f"before the recording {program.step + 1} of {before}"
        if program.step < before
        else f"step {program.step - before + 1} of {len(campaign.steps)}"
    )
    load = f", {' and '.join(program.now.load)}" if program.now.load else ""
    return f"{place}: {program.now.chamber_degC:g} degC{load}"
