"""A number that an option takes is finite: nothing lies between nan and anything."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import click
from click.types import FloatParamType


class Finite(FloatParamType):
    """``click.FLOAT`` without nan and inf."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number, or a refusal of the call."""
        found = super().convert(value, param, ctx)
        if not math.isfinite(found):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return found


class FiniteRange(Finite, click.FloatRange):
    """``click.FloatRange``, which lets nan pass, and inf where a bound is open."""


def sampling_option(meaning: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command on the simulated phone --period, a device's: 0.1 to 10 s."""
    return click.option(
        "--period", "period_s", type=FiniteRange(0.1, 10), default=1.0, show_default=True, metavar="S", help=meaning
    )
