"""A model file is JSON, taken whole or refused with every fault and its path in one message.

The unknown is refused: a key, a version, a shape. So is what cannot run: numbers that are not finite, an unstable A,
inputs without a range. Version 1 files are read for ever; a file without a version is not a model file. The keys
``guard``, ``spread`` and ``readings`` may be left out, and every other is needed.

A hostile file costs no more than a large honest one: its size, its counts, its numbers, its names and
what is said of its faults are bounded.
"""

import contextlib
import itertools
import json
import math
from collections.abc import Iterator
from typing import Any

from ambient_model.atomic import replacing
from ambient_model.faults import Fault, Refused, refuse
from ambient_model.intake import first_double, read_whole, shown
from ambient_model.model import (
    LEVELS_PERCENT,
    REGRESSORS,
    Band,
    Beyond,
    Conformance,
    Discrete,
    ErrorVariance,
    Estimator,
    Input,
    Matrix,
    Model,
    Quantiles,
    ReadingModel,
    Secondary,
    SensorLimits,
    Term,
)
from ambient_model.recursion import is_positive_definite, is_stable

FORMAT = "ambient-model"
VERSION = 1
_ESTIMATOR_KEYS = ("inputs", "states", "discrete", "offset", "initial", "interval")
_KEYS = ("format", "version", "name", "created", "output", *_ESTIMATOR_KEYS, "fallbacks", "provenance", "conformance")
_OPTIONAL_KEYS = ("guard", "spread", "readings")
_LARGEST_BYTES = 2**20
_LARGEST_INTEGER_DIGITS = 300
_LARGEST_NUMBER = 1e12
_LONGEST_TEXT = 200
_PERIOD_RANGE_S = (0.001, 86400.0)
_MOST_INPUTS = 32
_MOST_STATES = 16
_MOST_PERIODS = 16
_MOST_TERMS = 8
_MOST_LAGS = 4
_DEEPEST = 32
_MOST_FAULTS = 100
_LONGEST_KEY = 40


def load_model(path: str) -> Model:
    """The model in the file at ``path``; raises :class:`Refused` with every fault."""
    return decode(read_whole(path, _LARGEST_BYTES), path)


def decode(content: bytes, source: str) -> Model:
    """The model in ``content``; ``source`` names it in messages. Raises :class:`Refused` with every fault."""
    if len(content) > _LARGEST_BYTES:
        raise refuse(source, "", "larger than 1 MiB", "a model file is some kilobytes: is this one?")
    if not content.strip():
        raise refuse(source, "", "the file is empty", "export the model again with 'ambient-trainer fit'")
    try:
        data = json.loads(
            content.decode("utf-8-sig"), object_pairs_hook=_without_doubles, parse_constant=float, parse_int=_integer
        )
    except json.JSONDecodeError as error:
        raise refuse(
            source,
            f"line {error.lineno}, column {error.colno}",
            f"not JSON ({error.msg})",
            "is it cut off? export the model again",
        ) from error
    except (ValueError, RecursionError) as error:
        raise refuse(source, "", f"not JSON ({error})", "export the model again with 'ambient-trainer fit'") from error
    reading = _Reading()
    model = None
    with contextlib.suppress(_TooManyFaults):
        model = reading.model(data)
    if model is None or reading.faults:
        raise Refused(source, reading.faults)
    return model


def encode(model: Model) -> str:
    """The model as JSON text that :func:`decode` takes back to an equal model.

    What is not finite becomes the ``NaN`` or ``Infinity`` that :func:`decode` refuses by its place.
    """
    data: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "name": model.name,
        "created": model.created,
        "output": model.output,
        **_estimator_data(model.main),
        "fallbacks": [{"without": name, **_estimator_data(fallback)} for name, fallback in model.fallbacks.items()],
        "provenance": model.provenance,
        "conformance": {
            "inputs": model.conformance.inputs,
            "outputs": [
                {"period_s": period_s, "values": values} for period_s, values in model.conformance.outputs.items()
            ],
        },
    }
    if model.secondary is not None:
        estimator, threshold_degC = model.secondary
        data["guard"] = {"threshold_degC": threshold_degC, **_estimator_data(estimator)}
    if model.error_variance is not None:
        data["spread"] = {
            "constant_degC2": model.error_variance.constant_degC2,
            "terms": [each._asdict() for each in model.error_variance.terms],
            "quantiles": _quantiles_data(model.error_variance.quantiles),
        }
        if model.error_variance.beyond is not None:
            data["spread"]["beyond"] = model.error_variance.beyond._asdict()
    if model.readings is not None:
        data["readings"] = {**model.readings._asdict(), "sensors": [each._asdict() for each in model.readings.sensors]}
        if not model.readings.offset_gains:  # a file from before it keeps its text, by which a device knows it
            del data["readings"]["offset_gains"], data["readings"]["offset_std_degC"]
    return json.dumps(data, indent=1) + "\n"


def save_model(path: str, model: Model) -> None:
    """Write ``model`` to ``path``, whole or not at all. What :func:`load_model` would refuse is refused here."""
    text = encode(model)
    decode(text.encode(), path)
    with replacing(path) as stream:
        stream.write(text)


def _estimator_data(estimator: Estimator) -> dict[str, Any]:
    return {
        "inputs": [each._asdict() for each in estimator.inputs],
        "states": estimator.states,
        "discrete": [each._asdict() for each in estimator.discrete],
        "offset": estimator.offset,
        "initial": estimator.initial,
        "interval": _quantiles_data(estimator.interval),
    }


def _quantiles_data(quantiles: Quantiles) -> dict[str, Band]:
    return {str(level): band for level, band in quantiles.items()}


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError(f"key {shown(first_double([name for name, _ in pairs]))} is duplicated in one object")
    return found


def _integer(text: str) -> float:
    """An integer, or the infinity that stands for one beyond any float: a later fault names its place."""
    return int(text) if len(text) <= _LARGEST_INTEGER_DIGITS else float("-inf" if text[0] == "-" else "inf")


class _TooManyFaults(Exception):
    """There is no point in reading on."""


class _Reading:
    """One pass over the decoded JSON that notes every fault and goes on, up to a number that no honest file has."""

    def __init__(self) -> None:
        self.faults: list[Fault] = []
        self._absent: set[str] = set()
        """Places that a fault has already named as a whole."""

    def fault(self, place: str, problem: str, hint: str) -> None:
        if place not in self._absent:
            self.faults.append(Fault(place, problem, hint))
        if len(self.faults) > _MOST_FAULTS:
            self.faults[-1] = Fault("", "and there may be more", "is this a model file?")
            raise _TooManyFaults

    def model(self, data: Any) -> Model | None:
        if not isinstance(data, dict):
            self.fault("", f"holds {_kind(data)}, not an object", "is this a model file?")
            return None
        if data.get("format") != FORMAT:
            self.fault("format", f"is {_short(data.get('format'))}, not '{FORMAT}'", "is this a model file?")
            return None
        if type(data.get("version")) is not int or data["version"] != VERSION:
            self.fault(
                "version",
                f"is {_short(data.get('version'))}, and only {VERSION} is known",
                "export the model again, or update ambientd",
            )
            return None
        self.keys("", data, _KEYS, _OPTIONAL_KEYS)
        model = Model(
            name=self.text("name", data.get("name")),
            created=self.text("created", data.get("created")),
            output=self.text("output", data.get("output")),
            main=self.estimator("", data),
            fallbacks=self.fallbacks(data.get("fallbacks")),
            provenance=self.provenance(data.get("provenance")),
            conformance=self.conformance(data.get("conformance")),
            secondary=self.secondary(data["guard"]) if "guard" in data else None,
            error_variance=self.error_variance(data["spread"]) if "spread" in data else None,
            readings=self.readings(data["readings"]) if "readings" in data else None,
        )
        if not self.faults:
            self.agreement(model)
        return model

    def keys(self, place: str, data: dict[str, Any], needed: tuple[str, ...], optional: tuple[str, ...] = ()) -> None:
        known = (*needed, *optional)
        for key in data:
            if key not in known:
                self.fault(_join(place, key), "unknown key", f"known are {', '.join(known)}")
        for key in needed:
            if key not in data:
                self.fault(_join(place, key), "missing", "export the model again with 'ambient-trainer fit'")
                self._absent.add(_join(place, key))

    def text(self, place: str, value: Any) -> str:
        if not isinstance(value, str) or not value or not value.isprintable():
            self.fault(place, f"is {_short(value)}", "a text of printable characters is wanted")
            return ""
        if len(value) > _LONGEST_TEXT:
            self.fault(place, f"has {len(value)} characters", f"at most {_LONGEST_TEXT} are wanted")
            return ""
        return value

    def object(self, place: str, value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            self.fault(place, f"is {_kind(value)}", "an object is wanted")
            return {}
        return value

    def record(self, place: str, value: Any, known: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, Any]:
        """An object with the ``known`` keys, all of them, maybe the ``optional`` ones, and no others."""
        data = self.object(place, value)
        if isinstance(value, dict):
            self.keys(place, data, known, optional)
        else:
            self._absent.update([_join(place, key) for key in known])
        return data

    def provenance(self, value: Any) -> dict[str, Any]:
        """Any object whose numbers are finite."""
        self.document("provenance", value, _DEEPEST)
        return self.object("provenance", value)

    def document(self, place: str, value: Any, deepest: int) -> None:
        if isinstance(value, float) and not math.isfinite(value):
            self.fault(place, f"is {_short(value)}", "a finite number is wanted")
        elif isinstance(value, (dict, list)) and deepest == 0:
            self.fault(place, f"lies {_DEEPEST} levels deep", "nest less")
        elif isinstance(value, dict):
            for key, item in value.items():
                self.document(_join(place, key), item, deepest - 1)
        elif isinstance(value, list):
            for index, item in enumerate(value):
                self.document(f"{place}[{index}]", item, deepest - 1)

    def items(self, place: str, value: Any, most: int | None) -> list[Any]:
        if not isinstance(value, list):
            self.fault(place, f"is {_kind(value)}", "a list is wanted")
            return []
        if most is not None and len(value) > most:
            self.fault(place, f"has {len(value)} entries", f"at most {most} are wanted")
            return value[:most]
        return value

    def each(self, place: str, value: Any, most: int | None = None) -> Iterator[tuple[str, Any]]:
        return ((f"{place}[{index}]", item) for index, item in enumerate(self.items(place, value, most)))

    def number(self, place: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not _finite(value):
            self.fault(place, f"is {_short(value)}", "a finite number is wanted")
            return 0.0
        if abs(value) > _LARGEST_NUMBER:
            self.fault(place, f"is {_short(value)}", f"at most {_LARGEST_NUMBER:g} is wanted")
            return 0.0
        return float(value)

    def positive(self, place: str, value: Any) -> float:
        before = len(self.faults)
        found = self.number(place, value)
        if len(self.faults) == before and not found > 0:
            self.fault(place, f"is {found:g}", "more than 0 is wanted")
        return found

    def not_negative(self, place: str, value: Any) -> float:
        found = self.number(place, value)
        if found < 0:
            self.fault(place, f"is {found:g}", "0 or more is wanted")
        return found

    def vector(self, place: str, value: Any, length: int | None) -> tuple[float, ...]:
        found = tuple(self.number(where, each) for where, each in self.each(place, value))
        if isinstance(value, list) and length is not None and len(found) != length:
            self.fault(place, f"has {len(found)} numbers, not {length}", "one per column is wanted")
        return found

    def matrix(self, place: str, value: Any, rows: int | None, columns: int) -> Matrix:
        found = tuple(self.vector(where, row, columns) for where, row in self.each(place, value))
        if isinstance(value, list) and rows is not None and len(found) != rows:
            self.fault(place, f"has {len(found)} rows, not {rows}", f"the shape {rows} x {columns} is wanted")
        return found

    def estimator(self, place: str, data: dict[str, Any]) -> Estimator:
        given, named = _join(place, "inputs"), _join(place, "states")
        inputs = tuple(self.input(where, each) for where, each in self.each(given, data.get("inputs"), _MOST_INPUTS))
        states = tuple(self.text(where, each) for where, each in self.each(named, data.get("states"), _MOST_STATES))
        for what, names in ((given, [each.name for each in inputs]), (named, list(states))):
            for name in sorted({name for name in names if name and names.count(name) > 1}):
                self.fault(what, f"{name!r} is duplicated", "each needs a name of its own")
        if not inputs:
            self.fault(given, "none", "a model reads at least one sensor")
        discrete = self.discretes(_join(place, "discrete"), data.get("discrete"), len(states), len(inputs))
        return Estimator(
            inputs=inputs,
            states=states,
            discrete=discrete,
            offset=self.number(_join(place, "offset"), data.get("offset")),
            initial=self.matrix(_join(place, "initial"), data.get("initial"), len(states), len(inputs)),
            interval=self.interval(_join(place, "interval"), data.get("interval")),
        )

    def input(self, place: str, value: Any) -> Input:
        before = len(self.faults)
        data = self.record(place, value, Input._fields)
        low, high = self.number(f"{place}.min", data.get("min")), self.number(f"{place}.max", data.get("max"))
        if len(self.faults) == before and not low < high:
            self.fault(f"{place}.min", f"is {low:g}, not below max {high:g}", "give the range of plausible readings")
        name, unit, zone = (self.text(f"{place}.{key}", data.get(key)) for key in ("name", "unit", "zone"))
        return Input(name, unit, zone, low, high)

    def discretes(self, place: str, value: Any, states: int, inputs: int) -> tuple[Discrete, ...]:
        found = tuple(
            self.discrete(where, each, states, inputs) for where, each in self.each(place, value, _MOST_PERIODS)
        )
        if isinstance(value, list) and not found:
            self.fault(place, "none", "a model has coefficients for at least one period")
        self.once(place, [each.period_s for each in found])
        return found

    def once(self, place: str, periods: list[float]) -> None:
        for period_s in sorted({period_s for period_s in periods if period_s > 0 and periods.count(period_s) > 1}):
            self.fault(place, f"period {period_s:g} s is duplicated", "keep one")

    def discrete(self, place: str, value: Any, states: int, inputs: int) -> Discrete:
        before = len(self.faults)
        data = self.record(place, value, Discrete._fields)
        period_s = self.number(f"{place}.period_s", data.get("period_s"))
        shortest_s, longest_s = _PERIOD_RANGE_S
        if len(self.faults) == before and not shortest_s <= period_s <= longest_s:
            self.fault(
                f"{place}.period_s", f"is {period_s:g}", f"a period lies between {shortest_s:g} and {longest_s:g} s"
            )
        A = self.matrix(f"{place}.A", data.get("A"), states, states)
        found = Discrete(
            period_s,
            A,
            B=self.matrix(f"{place}.B", data.get("B"), states, inputs),
            C=self.matrix(f"{place}.C", data.get("C"), 1, states),
            D=self.matrix(f"{place}.D", data.get("D"), 1, inputs),
        )
        if len(self.faults) == before and not is_stable(A):
            self.fault(
                f"{place}.A",
                "is unstable: an eigenvalue lies on or outside the unit circle",
                "fit again; a passive circuit is stable",
            )
        return found

    def interval(self, place: str, value: Any) -> Quantiles:
        before = len(self.faults)
        data = self.record(place, value, tuple(str(level) for level in LEVELS_PERCENT))
        bands = {level: self.band(_join(place, str(level)), data.get(str(level))) for level in LEVELS_PERCENT}
        if len(self.faults) == before:
            for narrow, wide in itertools.pairwise(LEVELS_PERCENT):
                if not (bands[wide][0] <= bands[narrow][0] and bands[narrow][1] <= bands[wide][1]):
                    self.fault(
                        _join(place, str(wide)), f"does not contain the {narrow} % interval", "a higher level is wider"
                    )
        return bands

    def band(self, place: str, value: Any) -> Band:
        values = self.vector(place, value, 2)
        if len(values) != 2:
            return (0.0, 0.0)
        if values[0] > values[1]:
            self.fault(place, f"{values[0]:g} lies above {values[1]:g}", "the lower end stands first")
        return (values[0], values[1])

    def fallbacks(self, value: Any) -> dict[str, Estimator]:
        found: dict[str, Estimator] = {}
        for place, each in self.each("fallbacks", value, _MOST_INPUTS):
            data = self.record(place, each, ("without", *_ESTIMATOR_KEYS))
            without = self.text(f"{place}.without", data.get("without"))
            if without and without in found:
                self.fault(f"{place}.without", f"{without!r} is duplicated", "keep one")
            found[without] = self.estimator(place, data)
        return found

    def secondary(self, value: Any) -> Secondary:
        data = self.record("guard", value, ("threshold_degC", *_ESTIMATOR_KEYS))
        estimator = self.estimator("guard", data)
        return Secondary(estimator, self.positive("guard.threshold_degC", data.get("threshold_degC")))

    def error_variance(self, value: Any) -> ErrorVariance:
        data = self.record("spread", value, ("constant_degC2", "terms", "quantiles"), ("beyond",))
        return ErrorVariance(
            self.not_negative("spread.constant_degC2", data.get("constant_degC2")),
            tuple(self.term(where, each) for where, each in self.each("spread.terms", data.get("terms"), _MOST_TERMS)),
            self.interval("spread.quantiles", data.get("quantiles")),
            self.beyond("spread.beyond", data["beyond"]) if "beyond" in data else None,
        )

    def beyond(self, place: str, value: Any) -> Beyond:
        data = self.record(place, value, Beyond._fields)
        before, ends = len(self.faults), ("low_degC", "high_degC")
        low, high = (self.number(f"{place}.{key}", data.get(key)) for key in ends)
        if len(self.faults) == before and data.keys() >= {*ends} and low > high:
            self.fault(f"{place}.low_degC", f"{low:g} is above {high:g}", "give the lower one first")
        return Beyond(low, high, self.not_negative(f"{place}.weight", data.get("weight")))

    def term(self, place: str, value: Any) -> Term:
        data = self.record(place, value, Term._fields)
        of = self.text(f"{place}.of", data.get("of"))
        if of and of not in REGRESSORS:
            self.fault(f"{place}.of", f"is {shown(of)}", f"known are {', '.join(REGRESSORS)}")
        return Term(
            of,
            self.positive(f"{place}.lag_s", data.get("lag_s")),
            self.not_negative(f"{place}.weight", data.get("weight")),
        )

    def readings(self, value: Any) -> ReadingModel:
        data = self.record("readings", value, ReadingModel._fields[:-3], ReadingModel._fields[-3:])
        sensors = tuple(
            self.limits(where, each) for where, each in self.each("readings.sensors", data.get("sensors"), _MOST_INPUTS)
        )
        lags_s = tuple(
            self.positive(where, each) for where, each in self.each("readings.lags_s", data.get("lags_s"), _MOST_LAGS)
        )
        size, gains = len(sensors) * (1 + len(lags_s)), data.get("offset_gains")
        before = len(self.faults)
        precision = self.matrix("readings.precision", data.get("precision"), size, size)
        if len(self.faults) == before and not is_positive_definite(precision):
            self.fault("readings.precision", "is not positive definite", "fit again")
        return ReadingModel(
            lags_s=lags_s,
            mean=self.vector("readings.mean", data.get("mean"), size),
            precision=precision,
            sensors=sensors,
            jump_s=self.positive("readings.jump_s", data.get("jump_s")),
            settled_s=self.not_negative("readings.settled_s", data.get("settled_s")),
            output=self.band("readings.output", data.get("output")),
            rate_K_per_s=self.positive("readings.rate_K_per_s", data.get("rate_K_per_s")),
            starts=tuple(
                self.matrix(where, each, None, len(sensors))
                for where, each in self.each("readings.starts", data.get("starts", []), 2)
            ),
            offset_gains=self.matrix("readings.offset_gains", gains, len(sensors), len(sensors)) if gains else (),
            offset_std_degC=self.not_negative("readings.offset_std_degC", data.get("offset_std_degC", 0.0)),
        )

    def limits(self, place: str, value: Any) -> SensorLimits:
        needed, later = SensorLimits._fields[:-2], SensorLimits._fields[-2:]
        data = {**dict.fromkeys(later, 0.0), **self.record(place, value, needed, later)}
        may_be_zero = ("step", "effect_degC", "turn", "start")
        readers = {key: self.not_negative if key in may_be_zero else self.positive for key in SensorLimits._fields}
        return SensorLimits(*[read(f"{place}.{key}", data.get(key)) for key, read in readers.items()])

    def conformance(self, value: Any) -> Conformance:
        data = self.record("conformance", value, Conformance._fields)
        given = data.get("inputs")
        rows = len(given) if isinstance(given, list) else None
        width = len(given[0]) if isinstance(given, list) and given and isinstance(given[0], list) else 0
        inputs = self.matrix("conformance.inputs", given, None, width)
        outputs: list[tuple[float, tuple[float, ...]]] = []
        for place, each in self.each("conformance.outputs", data.get("outputs"), _MOST_PERIODS):
            entry = self.record(place, each, ("period_s", "values"))
            period_s = self.number(f"{place}.period_s", entry.get("period_s"))
            outputs.append((period_s, self.vector(f"{place}.values", entry.get("values"), rows)))
        self.once("conformance.outputs", [period_s for period_s, _ in outputs])
        return Conformance(inputs, dict(outputs))

    def agreement(self, model: Model) -> None:
        """Check the parts against each other."""
        main = model.main
        names = [each.name for each in main.inputs]
        for index, (without, fallback) in enumerate(model.fallbacks.items()):
            place = f"fallbacks[{index}]"
            if without not in names:
                self.fault(f"{place}.without", f"{without!r} is no input", f"inputs are {', '.join(names)}")
            strangers = [each.name for each in fallback.inputs if each not in main.inputs or each.name == without]
            if strangers:
                self.fault(
                    f"{place}.inputs",
                    f"without {without!r} reads {', '.join(strangers)}",
                    "a fallback reads the other inputs, unchanged",
                )
            if {each.period_s for each in fallback.discrete} != {each.period_s for each in main.discrete}:
                self.fault(
                    f"{place}.discrete", "the periods are not the model's", "a fallback runs at the model's periods"
                )
        self.agreement_of_secondary(model)
        if model.readings is not None:
            sensors, starts = model.readings.sensors, model.readings.starts
            if len(sensors) != len(main.inputs):
                self.fault("readings.sensors", f"{len(sensors)} for {len(main.inputs)} inputs", "one each")
            estimators = [main, *([model.secondary.estimator] if model.secondary else [])]
            if starts and [*map(len, starts)] != [len(each.states) for each in estimators]:
                self.fault("readings.starts", "are not of the estimators' states", "one row a state, one matrix each")
        if set(model.conformance.outputs) != {each.period_s for each in main.discrete}:
            self.fault(
                "conformance.outputs", "the periods are not those of 'discrete'", "one sequence per period is wanted"
            )
        if model.conformance.inputs and len(model.conformance.inputs[0]) != len(main.inputs):
            self.fault(
                "conformance.inputs",
                f"{len(model.conformance.inputs[0])} columns for {len(main.inputs)} inputs",
                "one per input is wanted",
            )
        if not model.conformance.inputs:
            self.fault("conformance.inputs", "none", "a model file carries the sequence that proves a port of it right")

    def agreement_of_secondary(self, model: Model) -> None:
        main = model.main
        if model.secondary is None:
            for index, term in enumerate(model.error_variance.terms if model.error_variance else ()):
                if term.of != "movement":
                    self.fault(f"spread.terms[{index}].of", f"is '{term.of}' without a 'guard'", "add the key 'guard'")
            return
        if model.secondary.estimator.inputs != main.inputs:
            self.fault(
                "guard.inputs",
                "are not the model's",
                "the secondary estimator reads the model's inputs, in their order",
            )
        if {each.period_s for each in model.secondary.estimator.discrete} != {each.period_s for each in main.discrete}:
            self.fault("guard.discrete", "the periods are not the model's", "it runs at the model's periods")


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the largest float
        return False


def _join(place: str, key: str) -> str:
    if not key.isprintable() or len(key) > _LONGEST_KEY:
        key = shown(key)
    return f"{place}.{key}" if place else key


def _kind(value: Any) -> str:
    names = {dict: "an object", list: "a list", str: "a text", bool: "true or false", type(None): "nothing"}
    return names.get(type(value), "a number")


def _short(value: Any) -> str:
    return _kind(value) if isinstance(value, (dict, list)) or value is None else shown(value)
