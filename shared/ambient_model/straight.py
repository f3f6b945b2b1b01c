"""The usual sample as straight-line Python source, written out when a model is loaded.

Nearly every sample is usual: it comes when it is due, every input is in its range, and no reading is missing, refused
or new to the validation. For these, the loops of :mod:`ambient_model.tracking`, :mod:`ambient_model.observer` and
:mod:`ambient_model.validation` are unrolled into one function with the model's numbers as literals. It does the same
operations in the same order, to the last bit, on the state of those objects, and takes a third of their time. Where a
sample is not usual it returns None before it has changed anything, and they take the sample themselves.

The process that ticks gets the compiled code and needs nothing of this module.
"""

import math
from collections.abc import Sequence
from types import CodeType

from ambient_model.error_variance import gains
from ambient_model.model import SCORES, Discrete, ErrorVariance, Input, Model, ReadingModel
from ambient_model.tracking import DEGRADED, TRACKING, WARMING_UP
from ambient_model.validation import DOUBT_S, SLOW_S, Validation

_HEAD = """
from math import sqrt
from ambient_model.blend import blended
from ambient_model.error_variance import VarianceState
from ambient_model.tracking import Estimate
new = tuple.__new__  # a named tuple's own costs a call more
def update(time_s, readings, main=main, observer=observer, secondary=secondary, validation=validation):  # as locals
"""
_SIDES = {"guard": "difference", "guard_above": "max(difference, 0.0)", "guard_below": "min(difference, 0.0)"}
"""What a term takes of the difference, as :mod:`ambient_model.error_variance` does."""


def compiled(model: Model, discrete: Discrete, level: int) -> CodeType:
    """The code of the main estimator's usual sample at the period of ``discrete``; ``level`` is the interval's percent.

    Run with the names ``main`` and ``secondary`` (trackers), ``observer`` and ``validation``, None where the model has
    none, it defines ``update(time_s, readings)``: the estimate, or None.
    """
    return compile(source(model, discrete, level), "<usual sample>", "exec")


def source(model: Model, discrete: Discrete, level: int) -> str:
    """The text that :func:`compiled` compiles."""
    inputs = model.main.inputs
    u, p = _names("u", len(inputs)), _names("p", len(inputs))
    period_s = discrete.period_s
    lines = [
        "step = main._step + 1",
        f"if not (main._begun and main._away is None"
        f" and step <= (time_s - main._start_s) / {period_s!r} + 0.5 < step + 1):",
        "    return None",
        f"{_list(u)} = readings",
    ]
    if model.error_variance is not None:
        lines += ["if observer._variance is None or observer._step != step - 1:", "    return None"]
    if model.readings is not None:
        lines += ["if observer._last is None:", "    return None"]
        lines += _validation(model, model.readings, period_s, u)
    else:
        ranges = " or ".join(_outside(name, each) for name, each in zip(u, inputs))
        lines += [f"if {ranges}:", "    return None", f"used = {_list(u)}"]
    lines += [f"{_list(p)} = main.last", *_tracker("main", model.main.offset, discrete, "x", u, p)]
    lines += ["main._step = step", "main.last = used"]
    lines += [f"status = {TRACKING!r} if step >= main.settling_steps else {WARMING_UP!r}", "ambient = y_main"]
    if model.secondary is not None:
        lines += _secondary(model, period_s, u, p)
    if model.error_variance is not None:
        lines += _sigma(model.error_variance, period_s, level, model.secondary is not None)
    else:
        low, high = model.main.interval[level]
        lines += [f"low = ambient + {low!r}", f"high = ambient + {high!r}"]
    if model.readings is not None:
        lines += _bounds(model.readings, level)
    lines.append(f"return new(Estimate, (ambient, low, high, status, ({', '.join(u)},)))")
    return _HEAD + "".join([f"    {line}\n" for line in lines])


def _outside(name: str, given: Input) -> str:
    """The condition of a reading that is missing or out of range."""
    return f"{name} is None or not {given.min!r} <= {name} <= {given.max!r}"


def _names(letter: str, count: int) -> list[str]:
    return [f"{letter}{i}" for i in range(count)]


def _list(names: Sequence[str]) -> str:
    return f"[{', '.join(names)}]"


def _sum(*products: tuple[Sequence[float], Sequence[str]]) -> str:
    """Factors times names, added one by one as the loops do; what adds 0 changes no bit."""
    terms = [f"{factor!r} * {name}" for factors, names in products for factor, name in zip(factors, names) if factor]
    return " + ".join(terms or ["0.0"])


def _tracker(of: str, offset: float, discrete: Discrete, letter: str, u: list[str], p: list[str]) -> list[str]:
    """x[k+1] = A x[k] + B u[k], y = C x + D u + offset, with p = u[k] and the new u = u[k+1]."""
    before = _names(letter, len(discrete.A))
    after = [f"{name}_" for name in before]
    lines = [f"{_list(before)} = {of}._x"] if before else []
    lines += [f"{name} = {_sum((a, before), (b, p))}" for name, a, b in zip(after, discrete.A, discrete.B)]
    lines.append(f"{of}._x = {_list(after)}")
    return [*lines, f"y_{of} = {_sum((discrete.C[0], after), (discrete.D[0], u))} + {offset!r}"]


def _secondary(model: Model, period_s: float, u: list[str], p: list[str]) -> list[str]:
    assert model.secondary is not None
    estimator, threshold_degC = model.secondary
    [discrete] = [each for each in estimator.discrete if each.period_s == period_s]
    return [
        *_tracker("secondary", estimator.offset, discrete, "v", u, p),
        "secondary._step = step",
        "secondary.last = used",
        "difference = y_main - y_secondary",
        f"if not {-threshold_degC!r} <= difference <= {threshold_degC!r}:",
        f"    ambient, difference, weight = blended(y_main, y_secondary, {threshold_degC!r})",
        f"    difference = min(max(difference, {-threshold_degC!r}), {threshold_degC!r})",
        "    if weight > 0:",
        f"        status = {DEGRADED!r}",
    ]


def _sigma(model: ErrorVariance, period_s: float, level: int, has_secondary: bool) -> list[str]:
    """:func:`ambient_model.error_variance.advanced` and its ``sigma_degC``."""
    means, squares = _names("m", len(model.terms)), _names("q", len(model.terms))
    lines = [f"{_list(means)}, {_list(squares)} = observer._variance"]
    for term, a, m, q in zip(model.terms, gains(model, period_s), means, squares):
        lines.append(f"{m} += {a!r} * (ambient - {m})")
        z = f"(ambient - {m})" if term.of == "movement" else _SIDES[term.of] if has_secondary else "0.0"
        lines.append(f"{q} += {a!r} * ({z} * {z} - {q})")
    if model.beyond is not None:
        low, high, _ = model.beyond
        lines.append(f"beyond = max(ambient - {high!r}, {low!r} - ambient, 0.0)")
    low, high = model.quantiles[level]
    pair = ", ".join(f"({''.join(f'{name}, ' for name in names)})" for names in (means, squares))
    added = [f"{term.weight!r} * {q}" for term, q in zip(model.terms, squares)]
    added += [] if model.beyond is None else [f"{model.beyond.weight!r} * (beyond * beyond)"]
    variance = " + ".join([repr(model.constant_degC2), *added])
    return [
        *lines,
        f"observer._variance = new(VarianceState, ({pair}))",
        "observer._step = step",
        f"observer.sigma_degC = sigma = sqrt({variance})",
        f"low = ambient + {low!r} * sigma",
        f"high = ambient + {high!r} * sigma",
    ]


def _validation(whole: Model, model: ReadingModel, period_s: float, u: list[str]) -> list[str]:
    """:meth:`ambient_model.validation.Validation.update` while nothing is set aside.

    What was used before and reads the same is in its range, and no jump.
    """
    count = len(u)
    lows, before, slow = _names("l", len(model.mean) - count), _names("b", count), _names("s", count)
    z, d, last = [*u, *lows], _names("d", count), _names("t", count)
    slow_gates, validation = _names("slow_gate", count), Validation(model, whole.main, period_s)
    slow_a = -math.expm1(-period_s / SLOW_S)
    a = [-math.expm1(-period_s / lag_s) for lag_s in model.lags_s for _ in range(count)]
    lines = [
        "looks = time_s >= validation._look_s",
        "if not validation.is_usual or looks and validation.is_standing(time_s)"
        f" or not {0.5 * period_s!r} < time_s - validation._time_s < {1.5 * period_s!r}:",
        "    return None",
        "moved = readings != validation._used",
        "if moved:",
        f"    {_list(before)} = validation._used",
    ]
    for i, (given, each) in enumerate(zip(whole.main.inputs, model.sensors)):
        lines += [
            f"    if {u[i]} != {before[i]}:",
            f"        if {_outside(u[i], given)} or abs({u[i]} - {before[i]}) > {each.jump!r}"
            f" or {u[i]} in {validation.sentinels[i]!r}:",
            "            return None",
        ]
    lines += [
        f"{_list(lows)} = lows = validation._lows",
        f"{_list(slow)} = validation._slow",
        f"gates, {_list(slow_gates)} = validation._limits",
        *([f"{_list(last)} = validation._last"] if any(each.turn for each in model.sensors) else []),
        "doubt_degC2 = 0.0",
    ]
    for i, (constant, weights, gain) in enumerate(validation.usual()):
        turn = model.sensors[i].turn
        lines += [
            f"{d[i]} = {u[i]} - {constant!r} - ({_sum((weights, z))})",
            f"if not -gates[{i}] <= {d[i]} <= gates[{i}]:",
            f"    doubt_degC2 = max(doubt_degC2, ({gain!r} * {d[i]}) ** 2)",
            *([f"if not {-turn!r} <= {d[i]} - {last[i]} <= {turn!r}:", "    return None"] if turn else []),
            f"if {slow[i]} > {slow_gates[i]} or {slow[i]} < -{slow_gates[i]}:",
            f"    doubt_degC2 = max(doubt_degC2, ({gain!r} * {slow[i]}) ** 2)",
        ]
    lines += [f"validation._used = used = {_list(u)}", "validation._z = z = used + lows", "if moved:"]
    for i in range(count):
        lines += [f"    if {u[i]} != {before[i]}:", f"        validation._still[{i}] = (time_s, {u[i]}, z)"]
    followed = [f"{low} + {gain!r} * ({u[k % count]} - {low})" for k, (low, gain) in enumerate(zip(lows, a))]
    return [
        *lines,
        "validation._time_s = time_s",
        "if looks:",
        "    validation._look_s = validation.next_look_s()",
        "validation.starts_anew = False",
        f"validation._last = {_list(d)}",
        f"validation._slow = {_list([f'{s} + {slow_a!r} * ({each} - {s})' for s, each in zip(slow, d)])}",
        f"validation._lows = {_list(followed)}",
        "if doubt_degC2:",
        "    validation._doubt_degC2, validation._doubt_s = doubt_degC2, time_s",
        f"validation.is_degraded = doubted = time_s - validation._doubt_s <= {DOUBT_S!r}",
        "validation.variance_degC2 = added_degC2 = validation._doubt_degC2 if doubted else 0.0",
    ]


def _bounds(model: ReadingModel, level: int) -> list[str]:
    """:meth:`ambient_model.observer.Observer._bounded` while nothing is missing."""
    near_K = 0.5 * model.rate_K_per_s * model.jump_s  # half the least reach: no rounding matters
    return [
        "y = ambient",
        f"if not {model.output[0]!r} <= y <= {model.output[1]!r}:",  # min and max take longer
        f"    y = min(max(y, {model.output[0]!r}), {model.output[1]!r})",
        "last_s, last_degC = observer._last",
        f"if not {-near_K!r} <= y - last_degC <= {near_K!r}:",
        f"    reach = {model.rate_K_per_s!r} * max(time_s - last_s, {model.jump_s!r})",
        "    y = min(max(y, last_degC - reach), last_degC + reach)",
        "observer._last = (time_s, y)",
        "if added_degC2 or y != ambient:",
        f"    added_degC2 += ((y - ambient) / {SCORES[level]!r}) ** 2",
        f"    low = y - sqrt((ambient - low) ** 2 + {SCORES[level] ** 2!r} * added_degC2)",
        f"    high = y + sqrt((high - ambient) ** 2 + {SCORES[level] ** 2!r} * added_degC2)",
        f"    if status == {TRACKING!r}:",
        f"        status = {DEGRADED!r}",
        f"elif doubted and status == {TRACKING!r}:",
        f"    status = {DEGRADED!r}",
        "ambient = y",
    ]
