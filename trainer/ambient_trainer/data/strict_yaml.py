"""A YAML file is taken whole or refused: no YAML, a key twice, an unknown key, a wrong value, each with its place."""

import os
import typing
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from ambient_model.faults import Fault, Refused, refuse

_Model = TypeVar("_Model", bound="Strict")


class Strict(BaseModel):
    """A part of a file: immutable, without unknown keys, its numbers finite, and nothing of what it calls wrong."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def _wrong(self) -> Iterator[tuple[str, str]]:
        """The problem and the hint of what is wrong between its values; the first counts."""
        return iter(())

    @model_validator(mode="after")
    def _right(self: _Model) -> _Model:
        for problem, hint in self._wrong():
            raise wrong(problem, hint)
        return self


def wrong(problem: str, hint: str) -> PydanticCustomError:
    """What a validator raises: the problem, and the hint that stands behind it in the message."""
    return PydanticCustomError("wrong", "{problem}", {"problem": problem, "hint": hint})


def holds(right: Callable[[Any], bool], problem: str, hint: str) -> AfterValidator:
    """For a field: ``right`` is to hold for its value, which ``{}`` stands for in the problem, where it has one."""

    def checked(value: Any) -> Any:
        if value is not None and not right(value):
            raise wrong(problem.format(value), hint)
        return value

    return AfterValidator(checked)


def shipped_path(
    kind: str, name: str | os.PathLike[str], folder: Path, names: Sequence[str], besides: Sequence[str] = ()
) -> str:
    """The file of ``folder`` of that name, or ``name`` itself where it is a YAML file's; else ``Refused``.

    ``besides`` are names that the caller takes itself, for the message.
    """
    name = os.fspath(name)
    if name in names:
        return str(folder / f"{name}.yaml")
    if not name.endswith((".yaml", ".yml")):
        known = ", ".join([*names, *besides])
        raise refuse(kind, "", f"none is called {name!r}", f"take one of {known}, or a .yaml file")
    return name


def load_yaml(path: str) -> Any:
    """What the YAML file at ``path`` holds; raises :class:`Refused` with line and column."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise refuse(path, "", f"cannot be read ({error.strerror})", "check the name and the permissions") from error
    except UnicodeDecodeError as error:
        raise refuse(path, "", "is not UTF-8 text", "save it as UTF-8") from error
    return parse_yaml(text, path)


def parse_yaml(text: str, source: str) -> Any:
    """What ``text`` holds; ``source`` names it in messages. Raises :class:`Refused` with line and column."""
    try:
        return yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = str(getattr(error, "problem", None) or error).splitlines()[0]
        raise refuse(source, place, f"not YAML ({problem})", "correct the indentation or the quotes") from error
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        # what the constructors of dates and tagged values raise comes through as it is
        raise refuse(source, "", f"not YAML ({error})", "put the value in quotes") from error


class _Loader(yaml.SafeLoader):
    """Refuses a key that is duplicated; YAML's own rule, which the parser does not keep."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            if isinstance(key_node, yaml.ScalarNode):
                if key_node.value in seen:
                    problem = f"key {key_node.value!r} is duplicated"
                    raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
                seen.add(key_node.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


def validated(model: type[_Model], data: Any, source: str, further: list[Fault] | None = None) -> _Model:
    """``data`` as a ``model``; raises :class:`Refused` with every fault in it and the ``further`` ones."""
    faults = list(further or [])
    try:
        parsed = model.model_validate(data)
    except ValidationError as error:
        details = error.errors()
        faults = [_fault(model, detail) for detail in details if not _follows(detail, details)] + faults
    if faults:
        raise Refused(source, faults)
    return parsed


def _follows(detail: ErrorDetails, details: list[ErrorDetails]) -> bool:
    """Whether a list is called too short only because an entry of it is wrong."""
    location = detail["loc"]
    inner = [each["loc"] for each in details if len(each["loc"]) > len(location)]
    return detail["type"] == "too_short" and any(each[: len(location)] == location for each in inner)


def _fault(model: type[BaseModel], detail: ErrorDetails) -> Fault:
    location = [part for part in detail["loc"] if part != "[key]"]
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".")
    kind, message = detail["type"], detail["msg"].replace("valid tuple", "list").replace("valid dictionary", "mapping")
    if kind == "extra_forbidden":
        known = ", ".join(_keys_at(model, location[:-1]))
        return Fault(place, "unknown key", f"remove it or correct its name; known are {known}")
    if kind == "missing":
        return Fault(place, "missing", "add it")
    hint = detail.get("ctx", {}).get("hint")
    if hint:
        return Fault(place, message, str(hint))
    if kind == "model_type":
        message = "input should be a mapping, 'key: value'"
    text = repr(detail["input"])
    shown = text if len(text) <= 40 else f"{text[:37]}..."
    return Fault(place, f"{shown}: {message[0].lower()}{message[1:]}", "correct it")


def _keys_at(model: type[BaseModel], location: Sequence[int | str]) -> list[str]:
    """The keys that the part of a file at ``location`` may have."""
    for part in location:
        fields = {field.alias or name: field.annotation for name, field in model.model_fields.items()}
        model = next(_models_in(fields.get(str(part))), model)
    return [field.alias or name for name, field in model.model_fields.items()]


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in typing.get_args(annotation):
        yield from _models_in(argument)
