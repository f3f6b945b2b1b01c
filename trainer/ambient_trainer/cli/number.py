"""A number that an option takes is finite: nothing lies between nan and anything."""

from __future__ import annotations

import math
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
