"""A configuration is YAML, or JSON where the file ends with .json; it is taken whole or refused with every fault.

Paths that are not absolute are taken from the configuration's own folder. A hostile file costs no more than a
large honest one.
"""

import os
from collections.abc import Callable, Sequence
from typing import Any

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.intake import first_double, read_whole, shown
from ambient_model.model import LEVELS_PERCENT
from ambientd.publish.access import Access, read_access
from ambientd.publish.proof import created
from ambientd.publish.spec import Spec, kind_module, parse
from ambientd.settings import ReferenceSpec, Settings, StateSpec
from ambientd.sources.quantities import SIGMA_RANGE_DEGC
from ambientd.sources.spec import Location, read_location, read_rules

RATE_RANGE_HZ = (0.1, 20.0)
MAX_AGE_RANGE_S = (1.0, 3600.0)
COAST_RANGE_S = (0.0, 600.0)
"""All readings since the loss are kept: at 20 Hz ten minutes are some megabytes."""
_KEYS = (
    "model",
    "rate_hz",
    "sysfs_root",
    "publish",
    "level_percent",
    "zones",
    "coast_s",
    "state",
    "zones_by_name",
    "sensors",
    "supervision",
    "access",
    "reference",
)
_LARGEST_BYTES = 2**16
_LONGEST_TEXT = 1000
_LONGEST_PROBLEM = 200
_MOST_FAULTS = 100
_MOST_PUBLISHERS = 32
_STATE_KEYS = ("path", "max_age_s", "access")
_OWN_PATH = "give each a path of its own"
_UNITS = ("degC", "millidegC")
_REFERENCE_RANGES = {
    "sigma_degC": SIGMA_RANGE_DEGC,
    "max_age_s": (1.0, 86400.0),
    "correlation_s": (60.0, 7 * 86400.0),
    "offset_std_degC": (0.01, 5.0),
    "max_offset_degC": (0.01, 10.0),
    "forget_days": (1.0, 3650.0),
}


def settings_for_model(path: str) -> Settings:
    """The defaults around the model file at ``path``."""
    return Settings(source=path, model=path)


def publishing_to(settings: Settings, specs: Sequence[Spec]) -> Settings:
    """``settings`` with ``specs``, which have no access of their own, in place of what is published."""
    settings = settings._replace(publish=tuple([_accessible(spec, settings.access) for spec in specs]))
    for problem in _clashes(settings):
        raise refuse("--publish", "", problem, _OWN_PATH)
    return settings


def _clashes(settings: Settings) -> list[str]:
    """What several outputs, or one and the state, would write, or what one would write over that the daemon reads."""
    paths = [os.path.realpath(each.path) for each in created(settings.publish, settings.state)]
    given = [settings.source, settings.model, *([settings.reference.path] if settings.reference else [])]
    read = {os.path.realpath(each) for each in given}
    twice = {f"{path} is duplicated" for path in paths if paths.count(path) > 1}
    return sorted(twice | {f"{path} is what the daemon reads" for path in paths if path in read})


def _accessible(spec: Spec, access: Access) -> Spec:
    return spec._replace(access=access) if spec.path else spec


def load_settings(path: str) -> Settings:
    """The settings in the file at ``path``; raises :class:`Refused` with every fault."""
    content = read_whole(path, _LARGEST_BYTES)
    if len(content) > _LARGEST_BYTES:
        raise refuse(path, "", "larger than 64 KiB", "a configuration is some lines: is this one?")
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        raise refuse(path, "", f"not text ({error})", "save it as UTF-8") from error
    data = _json(path, text) if path.endswith(".json") else _yaml(path, text)
    reading = _Reading(path)
    settings = reading.settings(data)
    if reading.faults:
        raise Refused(path, reading.faults[:_MOST_FAULTS])
    return settings


def _json(path: str, text: str) -> Any:
    import json

    try:
        return json.loads(text, object_pairs_hook=_without_doubles)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise refuse(path, place, f"not JSON ({error.msg})", "correct it there") from error
    except (ValueError, RecursionError) as error:
        raise refuse(path, "", str(error), "correct it") from error


def _yaml(path: str, text: str) -> Any:
    import importlib

    try:
        yaml: Any = importlib.import_module("yaml")
    except ImportError as error:
        raise refuse(
            path,
            "",
            "is YAML, and PyYAML is not installed",
            "install 'ambientd[yaml]', or write the same keys as JSON into a file that ends with .json",
        ) from error
    try:
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        _refuse_tricks(node, set())
        return None if node is None else loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise refuse(path, place, f"not YAML ({error.problem})", "correct it there") from error
    except RecursionError as error:
        raise refuse(path, "", "nested too deep", "nest less") from error
    except (yaml.YAMLError, ValueError) as error:
        raise refuse(path, "", str(error), "correct it") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError) as error:  # of a value that does not fit its tag
        raise refuse(path, "", f"a value does not fit its tag ({error})", "write it without a tag") from error


def _refuse_tricks(node: Any, seen: set[int]) -> None:
    """Refuse what YAML accepts silently: a duplicate key, of which the last wins, and aliases, which multiply."""
    if node is None:
        return
    if node.id == "scalar" and len(node.value) > _LONGEST_TEXT:
        raise ValueError(f"what stands in line {node.start_mark.line + 1} has {len(node.value)} characters")
    if id(node) in seen:
        raise ValueError(f"what begins in line {node.start_mark.line + 1} is used again by an alias: write it twice")
    seen.add(id(node))
    if node.id == "mapping":
        _without_doubles([(str(key.value), value) for key, value in node.value])
    for each in node.value if node.id != "scalar" else ():
        for child in each if node.id == "mapping" else (each,):
            _refuse_tricks(child, seen)


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    double = first_double([name for name, _ in pairs])
    if double is not None:
        raise ValueError(f"key {shown(double)} is duplicated in one mapping")
    return dict(pairs)


def _printable(text: str) -> str:
    """``text`` on one line of bounded length: keys and values are untrusted."""
    if not text.isprintable():
        text = repr(text)
    return text if len(text) <= _LONGEST_PROBLEM else f"{text[: _LONGEST_PROBLEM - 3]}..."


class _Reading:
    """One pass over the decoded configuration that notes every fault and goes on."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.faults: list[Fault] = []
        self.common_access = Access()

    def fault(self, place: str, problem: str, hint: str) -> None:
        self.faults.append(Fault(_printable(place), _printable(problem), hint))

    def settings(self, data: Any) -> Settings:
        settings = Settings(source=self.path, model="")
        if not isinstance(data, dict):
            self.fault("", "holds no keys", f"start with 'model: MODEL.json'; known keys are {', '.join(_KEYS)}")
            return settings
        self.unknown("", data, _KEYS)
        if "access" in data:  # what follows builds on it
            self.common_access = self.access("access", data["access"])
        settings = settings._replace(access=self.common_access)
        readers: dict[str, Callable[[str, Any], Any]] = {
            "model": self.file,
            "rate_hz": lambda place, value: self.number(place, value, RATE_RANGE_HZ),
            "sysfs_root": self.file,
            "publish": self.publish,
            "level_percent": self.level,
            "zones": self.zones,
            "coast_s": lambda place, value: self.number(place, value, COAST_RANGE_S),
            "state": self.state,
            "zones_by_name": self.file,
            "sensors": self.sensors,
            "supervision": lambda place, value: read_rules(place, value, self.fault),
            "reference": self.reference,
        }
        zones, sensors = data.get("zones"), data.get("sensors")
        if isinstance(zones, dict) and isinstance(sensors, dict):
            for name in filter(sensors.__contains__, zones):
                self.fault(f"sensors.{name}", "stands under 'zones', too", "name it once")
        if "reference" in data and "state" not in data:
            self.fault("reference", "needs 'state', where what is learnt is kept", "add 'state: {path: FILE}'")
        if "model" not in data:
            self.fault("model", "missing", "name the model file")
        settings = settings._replace(**{key: read(key, data[key]) for key, read in readers.items() if key in data})
        for problem in _clashes(settings):
            self.fault("publish", problem, _OWN_PATH)
        return settings

    def unknown(self, place: str, data: dict[Any, Any], known: tuple[str, ...]) -> None:
        for key in data:
            if key not in known:
                self.fault(f"{place}{key}", "unknown key", f"known are {', '.join(known)}")

    def text(self, place: str, value: Any) -> str:
        if not isinstance(value, str) or not value:
            self.fault(place, f"is {value!r}", "a text is wanted")
            return ""
        if not value.isprintable() or len(value) > _LONGEST_TEXT:
            wanted = f"a text of at most {_LONGEST_TEXT} printable characters is wanted"
            self.fault(place, f"is {shown(value)}", wanted)
            return ""
        return value

    def file(self, place: str, value: Any) -> str:
        return os.path.join(os.path.dirname(self.path), self.text(place, value))

    def number(self, place: str, value: Any, limits: tuple[float, float]) -> float:
        low, high = limits
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            self.fault(place, f"is {value!r}", f"a number between {low:g} and {high:g} is wanted")
            return low
        return float(value)

    def state(self, place: str, value: Any) -> StateSpec | None:
        if not isinstance(value, dict):
            self.fault(place, f"is {value!r}", "a mapping with path and max_age_s is wanted")
            return None
        self.unknown(f"{place}.", value, _STATE_KEYS)
        if "path" not in value:
            self.fault(f"{place}.path", "missing", "name the file that the state is kept in")
            return None
        spec = StateSpec(self.file(f"{place}.path", value["path"]), access=self.common_access)
        if "access" in value:
            spec = spec._replace(access=self.access(f"{place}.access", value["access"]))
        if "max_age_s" not in value:
            return spec
        return spec._replace(max_age_s=self.number(f"{place}.max_age_s", value["max_age_s"], MAX_AGE_RANGE_S))

    def reference(self, place: str, value: Any) -> ReferenceSpec | None:
        if not isinstance(value, dict):
            self.fault(place, f"is {value!r}", "a mapping is wanted; '{}' is for 'ambientd tell' alone")
            return None
        self.unknown(f"{place}.", value, ("path", "unit", *_REFERENCE_RANGES))
        spec = ReferenceSpec()
        if "path" in value:
            spec = spec._replace(path=self.file(f"{place}.path", value["path"]))
        if "unit" in value:
            if value["unit"] not in _UNITS:
                self.fault(f"{place}.unit", f"is {shown(value['unit'])}", f"one of {', '.join(_UNITS)} is wanted")
            spec = spec._replace(unit=value["unit"])
        numbers: dict[str, Any] = {
            key: self.number(f"{place}.{key}", value[key], limits)
            for key, limits in _REFERENCE_RANGES.items()
            if key in value
        }
        return spec._replace(**numbers)

    def level(self, place: str, value: Any) -> int:
        if type(value) is not int or value not in LEVELS_PERCENT:
            self.fault(place, f"is {value!r}", f"one of {', '.join(map(str, LEVELS_PERCENT))} is wanted")
            return 90
        return value

    def zones(self, place: str, value: Any) -> dict[str, str]:
        if not isinstance(value, dict):
            self.fault(place, f"is {value!r}", "a mapping from input name to thermal zone type is wanted")
            return {}
        return {str(name): self.text(f"{place}.{name}", zone) for name, zone in value.items()}

    def sensors(self, place: str, value: Any) -> dict[str, Location]:
        if not isinstance(value, dict):
            self.fault(place, f"is {value!r}", "a mapping from input name to where it is read is wanted")
            return {}
        read = {str(name): read_location(f"{place}.{name}", each, self.fault) for name, each in value.items()}
        return {name: location for name, location in read.items() if location}

    def publish(self, place: str, value: Any) -> tuple[Spec, ...]:
        if not isinstance(value, list) or not value:
            self.fault(place, f"is {value!r}", "a list of KIND:PATH or of mappings is wanted")
            return ()
        if len(value) > _MOST_PUBLISHERS:
            self.fault(place, f"has {len(value)} entries", f"at most {_MOST_PUBLISHERS} are wanted")
            return ()
        specs = [self.spec(f"{place}[{index}]", item) for index, item in enumerate(value)]
        return tuple(spec for spec in specs if spec)

    def spec(self, place: str, value: Any) -> Spec | None:
        if isinstance(value, str):
            return self.parsed(place, value)
        if not isinstance(value, dict):
            self.fault(place, f"is {value!r}", "KIND:PATH or a mapping is wanted")
            return None
        kind = self.text(f"{place}.kind", value.get("kind"))
        path = self.text(f"{place}.path", value["path"]) if "path" in value else ""
        spec = self.parsed(place, f"{kind}:{path}" if path else kind) if kind else None
        if spec is None:
            return None
        module = kind_module(spec.kind)
        keys = getattr(module, "KEYS", ())
        self.unknown(f"{place}.", value, ("kind", "path", *keys, "access"))
        if keys:
            spec = module.configured(spec, place, value, self.fault)
        if "access" in value and not spec.path:
            self.fault(f"{place}.access", f"has no effect on kind {spec.kind!r}", "remove it")
        return spec._replace(access=self.access(f"{place}.access", value["access"])) if "access" in value else spec

    def parsed(self, place: str, text: str) -> Spec | None:
        try:
            spec = parse(text)
        except ValueError as error:
            problem, _, hint = str(error).partition("; ")
            self.fault(place, problem, hint)
            return None
        return _accessible(spec._replace(path=self.file(place, spec.path)), self.common_access) if spec.path else spec

    def access(self, place: str, value: Any) -> Access:
        return read_access(place, value, self.common_access, self.fault)
