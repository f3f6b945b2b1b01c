"""Small stand-ins for ``typing`` and ``collections.abc``, which a process that only ticks can do without.

Only ``ambientd run`` installs them, before it imports anything else; :func:`restore` lets other modules find the real
ones. What is annotated is the same: type checkers never see this.
"""

import _collections_abc
import sys
from _collections import _tuplegetter  # type: ignore[import-not-found]

_NEW = tuple.__new__


class _Fields(type):
    """Makes a class with annotated fields a tuple with those names, as ``typing.NamedTuple`` does."""

    def __new__(cls, name, bases, space):  # type: ignore[no-untyped-def]
        if not bases:
            return type.__new__(cls, name, bases, space)
        fields = tuple(space.pop("__annotations__", ()))
        defaults = {each: space.pop(each) for each in fields if each in space}
        heads = ", ".join([f"{each}=_defaults[{each!r}]" if each in defaults else each for each in fields])
        source = f"lambda _cls, {heads}: _new(_cls, ({''.join([f'{each}, ' for each in fields])}))"
        space["__new__"] = eval(source, {"_new": _NEW, "_defaults": defaults})
        space.update({each: _tuplegetter(index, None) for index, each in enumerate(fields)})
        return type(name, (tuple,), {"_fields": fields, "__slots__": (), **_METHODS, **space})


def _replace(self, **values):  # type: ignore[no-untyped-def]
    return _NEW(type(self), [values.get(name, value) for name, value in zip(self._fields, self)])


def _asdict(self):  # type: ignore[no-untyped-def]
    return dict(zip(self._fields, self))


def _shown(self):  # type: ignore[no-untyped-def]
    return f"{type(self).__name__}({', '.join([f'{name}={value!r}' for name, value in zip(self._fields, self)])})"


_METHODS = {"_replace": _replace, "_asdict": _asdict, "__repr__": _shown}


class _Typing:
    """What the device's modules take from ``typing``."""

    TYPE_CHECKING = False
    Any = object
    Protocol = object
    NamedTuple = _Fields("NamedTuple", (), {})  # type: ignore[no-untyped-call]


_STAND_INS = {"collections.abc": _collections_abc, "typing": _Typing}


def install() -> None:
    """Put the stand-ins in place, unless the real ones are loaded; from Python 3.14 on annotations are made later."""
    if sys.version_info < (3, 14):
        for name, module in _STAND_INS.items():
            sys.modules.setdefault(name, module)  # type: ignore[arg-type]


def restore() -> None:
    """Let what is imported from now on find the real ones."""
    for name, module in _STAND_INS.items():
        if sys.modules.get(name) is module:
            del sys.modules[name]
