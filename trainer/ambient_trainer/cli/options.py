"""Options that several commands share, each written once: a decorator gives a command its arguments."""

import contextlib
import functools
import math
from collections.abc import Callable
from typing import Any, TypeAlias

import click
from click.types import FloatParamType

import ambient_trainer as at
from ambient_trainer.cli.output import Output

Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]


class Finite(FloatParamType):
    """``click.FLOAT`` without nan and inf: nothing lies between nan and anything."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number; the call is refused where it is not finite."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class FiniteRange(Finite, click.FloatRange):
    """``click.FloatRange``, which lets nan pass, and inf where a bound is open."""


def output_options(data: str = "the figures", page: bool = False) -> Decorator:
    """Give a command --json, and --report with ``page``, as its ``output``: an :class:`Output`."""
    report = click.option("--report", "report_folder", metavar="DIR", help="Write a page with plots into this folder.")

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @click.option("--json", "json_path", metavar="OUT", help=f"Write {data} to this file as JSON.")
        @functools.wraps(command)
        def with_output(json_path: str | None, report_folder: str | None = None, **rest: Any) -> Any:
            return command(output=Output(json_path, report_folder), **rest)

        return report(with_output) if page else with_output

    return decorate


def window_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give ``command`` --from and --to, as ``from_s`` and ``to_s``; refuse the call where they leave nothing."""

    @click.option("--from", "from_s", type=Finite(), metavar="S", help="Leave out the samples before this time_s.")
    @click.option("--to", "to_s", type=Finite(), metavar="S", help="Leave out the samples from this time_s on.")
    @functools.wraps(command)
    def with_window(from_s: float | None, to_s: float | None, **rest: Any) -> Any:
        if from_s is not None and to_s is not None and not from_s < to_s:
            raise click.UsageError(f"--from {from_s:.10g} does not come before --to {to_s:.10g}")
        return command(from_s=from_s, to_s=to_s, **rest)

    return with_window


def circuit_option(meaning: str = "A shipped circuit or a .yaml file.", **attributes: Any) -> Decorator:
    """Give a command --circuit, which must be given."""
    return click.option("--circuit", required=True, metavar="NAME|FILE", help=meaning, **attributes)


def period_option(default: str = "the trace's own") -> Decorator:
    """Give a command on logged traces --period, as ``period_s``."""
    grid = FiniteRange(min=1e-3)
    return click.option("--period", "period_s", type=grid, metavar="S", show_default=default, help="Grid.")


def sampling_option(meaning: str, longest_s: float = 10) -> Decorator:
    """Give a command on the simulated phone --period, as ``period_s``: a device's, from 0.1 s on."""
    period = FiniteRange(0.1, longest_s)
    return click.option("--period", "period_s", type=period, default=1.0, metavar="S", help=meaning)


starts_option = click.option("--starts", type=click.IntRange(1, 1000), default=8, help="Number of starting points.")
"""Gives a command --starts."""


def effort_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give ``command`` --starts, --pieces and --seed, as its ``effort``."""
    meaning = "Number of pieces a trace is cut into, each fitted from a cold start."

    @starts_option
    @click.option("--pieces", type=click.IntRange(1, 10_000), default=1, help=meaning)
    @seed_option("Of the starting points.")
    @functools.wraps(command)
    def with_effort(starts: int, pieces: int, seed: int, **rest: Any) -> Any:
        return command(effort=at.Effort(starts, seed, pieces), **rest)

    return with_effort


def sensors_option(default: str = "every _degC column", meaning: str = "What free-N and observers read.") -> Decorator:
    """Give a command --sensors, the names of columns."""
    return click.option("--sensors", type=names, default="", metavar="A,B,...", show_default=default, help=meaning)


def seed_option(meaning: str) -> Decorator:
    """Give a command --seed."""
    return click.option("--seed", type=click.IntRange(min=0), default=0, help=meaning)


def jobs_option(meaning: str) -> Decorator:
    """Give a command --jobs, by default as many processes as there are cores."""
    return click.option(
        "--jobs", type=click.IntRange(1, 256), default=_cores, show_default="as many as there are cores", help=meaning
    )


def names(text: str) -> tuple[str, ...]:
    """The type of an option that lists names, such as ``usb,battery``."""
    return tuple(name for part in text.split(",") if (name := part.strip()))


def whole_numbers(text: str) -> tuple[int, ...]:
    """The type of an option that lists numbers from 0 on, such as ``3,4,5``; each counts once."""
    parts = names(text)
    if not parts or not all(part.isascii() and part.isdigit() for part in parts):
        raise click.BadParameter(f"{text!r}: write whole numbers with commas between, such as 3,4,5")
    return tuple(dict.fromkeys(map(int, parts)))


def assigned(form: str, read: Callable[[str], Any] = str) -> Callable[[str], tuple[str, Any]]:
    """The type of an option NAME=VALUE; ``form`` says so, with an example, where something else is given."""

    def pair(text: str) -> tuple[str, Any]:
        name, _, value = text.partition("=")
        with contextlib.suppress(ValueError):
            if name and value:
                return name, read(value)
        raise click.BadParameter(f"{text!r}: write {form}")

    return pair


def _cores() -> int:
    import joblib  # --help should not wait for it

    return int(joblib.cpu_count())
