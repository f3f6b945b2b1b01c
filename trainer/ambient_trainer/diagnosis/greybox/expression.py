"""Expressions of logged columns that drive effects, parsed by a small grammar and never by ``eval``.

Columns by name, numbers, ``+ - * /``, ``^`` with a number, ``>`` and ``<`` (1 where true, else 0), ``sqrt(x)``,
``abs(x)``, ``d(x)/dt``, ``lag(x, seconds)`` of first order and ``delay(x, seconds)``: ``current_A^2 * charge_frac``,
``ambient_degC > 25``.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged
from ambient_trainer.report.words import unit_of

_RATE = re.compile(r"\bd\(([A-Za-z0-9_ ^*+\-./()]+?)\)\s*/\s*dt\b")
LATE = ("delay", "lag")
_LEVEL = re.compile(rf"^((?:{'|'.join(LATE)})\(\w+, |\w+ > )([-+.\de]+)(\)?)$")
_HINT = (
    "use columns of the trace, numbers, + - * / ^, > and <, sqrt, abs, d(x)/dt, lag(x, seconds) and delay(x, seconds)"
)


def words_in(*columns: str) -> set[str]:
    """The words in columns' names, without the numbers of what there is several times."""
    return {word.rstrip("0123456789") for each in columns for word in each.lower().split("_")}


@dataclass(frozen=True)
class Samples:
    """What an expression is evaluated on: columns (N,) every ``period_s``."""

    columns: Mapping[str, Array]
    period_s: float

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a column."""
        return next(iter(self.columns.values())).shape


@dataclass(frozen=True)
class Expression:
    """An expression of logged columns, by its ``text``."""

    text: str

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """The columns that it reads, in order."""
        names = [each for each in ast.walk(_parsed(self.text)) if isinstance(each, ast.Name)]
        ordered = sorted(names, key=lambda each: each.col_offset)
        return tuple(dict.fromkeys(each.id for each in ordered if each.id not in _FUNCTIONS))

    def per(self, unit: str) -> str:
        """``unit`` per unit of this: ``W/A^2``, ``W per m/s``; what is on or off, and a fraction, has none."""
        text = self.columns[0] if self.late else self.text
        name, _, power = text.partition("^")
        if self.columns == (name,):
            own = unit_of(name)
            raised = f"({own})" if "/" in own else own
            return f"{unit}/{raised}^{power}" if power else f"{unit} per {own}" if own else unit
        return unit if self.switches else f"{unit} per {self.text}"

    @property
    def level(self) -> float | None:
        """The number of a column that acts later, or beyond a level; None for any other expression."""
        found = _LEVEL.search(self.text)
        return None if found is None else float(found[2])

    def at_level(self, value: float) -> Expression:
        """It with another such number."""
        return Expression(_LEVEL.sub(rf"\g<1>{value:.4g}\g<3>", self.text))

    @property
    def form(self) -> str:
        """Its text without that number."""
        return _LEVEL.sub(r"\g<1>\g<3>", self.text)

    @property
    def late(self) -> bool:
        """Whether it is a column that acts later."""
        return self.text.startswith(tuple(f"{each}(" for each in LATE))

    @property
    def switches(self) -> bool:
        """Whether it is a comparison: 0 or 1."""
        return isinstance(_parsed(self.text).body, ast.Compare)

    def value(self, samples: Samples) -> Array:
        """Its value at each sample, (N,); raises :class:`Refused` where a column is missing."""
        result = _value(_parsed(self.text).body, samples, self.text)
        return np.broadcast_to(np.asarray(result, dtype=float), samples.shape)


@lru_cache(maxsize=4096)
def _parsed(text: str) -> ast.Expression:
    source = _RATE.sub(r"rate(\1)", text).replace("^", "**")
    try:
        return ast.parse(source, mode="eval")
    except SyntaxError:
        raise refuse("expression", repr(text), "cannot be read", _HINT) from None


def _delayed(row: Array, seconds: float, period_s: float) -> Array:
    time_s = period_s * np.arange(len(row))
    return np.asarray(np.interp(time_s - seconds, time_s, row))


_FUNCTIONS: Mapping[str, Callable[..., Array]] = {
    "sqrt": lambda period_s, row: np.sqrt(np.maximum(row, 0.0)),
    "abs": lambda period_s, row: np.abs(row),
    "rate": lambda period_s, row: np.gradient(row, period_s),
    "lag": lambda period_s, row, seconds: lagged(row, float(seconds), period_s) if seconds else row,
    "delay": lambda period_s, row, seconds: _delayed(row, float(seconds), period_s),
}
_OPERATORS: Mapping[type[ast.AST], Callable[[Array, Array], Array]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: lambda one, other: np.divide(one, np.where(other == 0, np.inf, other)),
    ast.Pow: lambda base, power: np.sign(base) ** (power % 2) * np.abs(base) ** power,
    ast.Gt: np.greater,
    ast.Lt: np.less,
}


def _value(node: ast.AST, samples: Samples, text: str) -> Array:
    match node:
        case ast.Constant(value=int() | float() as number):
            return np.asarray(float(number))
        case ast.Name(id=name) if name in samples.columns:
            return samples.columns[name]
        case ast.Name(id=name):
            known = ", ".join(samples.columns)
            raise refuse("expression", repr(text), f"no column {name!r}", f"the trace has {known}")
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand, samples, text)
        case ast.BinOp(left=left, op=op, right=right) | ast.Compare(left=left, ops=[op], comparators=[right]) if (
            type(op) in _OPERATORS
        ):
            return np.asarray(_OPERATORS[type(op)](_value(left, samples, text), _value(right, samples, text)), float)
        case ast.Call(func=ast.Name(id=name), args=given) if name in _FUNCTIONS:
            return _called(name, [_value(each, samples, text) for each in given], samples, text)
    raise refuse("expression", repr(text), "cannot be read", _HINT)


def _called(name: str, given: Sequence[Array], samples: Samples, text: str) -> Array:
    if len(given) != 1 + (name in LATE):
        what = "a column and seconds" if name in LATE else "one column"
        raise refuse("expression", repr(text), f"{name} takes {what}", _HINT)
    row, *seconds = given
    if any(each.shape or not 0 <= each < np.inf for each in seconds):
        raise refuse("expression", repr(text), f"{name} takes seconds as a number of 0 or more", _HINT)
    return _FUNCTIONS[name](samples.period_s, np.broadcast_to(row, samples.shape), *seconds)
