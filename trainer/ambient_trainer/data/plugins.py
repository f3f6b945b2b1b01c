"""Plug-ins: a module in a package's folder, or an entry point, is found by its place."""

import importlib
import pkgutil
from functools import cache
from importlib.metadata import entry_points
from types import ModuleType


@cache
def plugin_names(package: str) -> dict[str, str]:
    """Names of the plug-ins of a package and the modules that hold them, sorted by name.

    Each module of ``package`` is a plug-in (with ``-`` for ``_``), unless its name starts with ``_``; so is each entry
    point of the group of that name.
    """
    folder = importlib.import_module(package)
    found = {
        each.name.rstrip("_").replace("_", "-"): f"{package}.{each.name}"
        for each in pkgutil.iter_modules(folder.__path__)
        if not each.name.startswith("_")
    }
    found.update((each.name, each.module) for each in entry_points(group=package))
    return dict(sorted(found.items()))


def plugin(package: str, name: str) -> ModuleType:
    """The module of the plug-in ``name`` of ``package``; raises ``KeyError`` where there is none."""
    return importlib.import_module(plugin_names(package)[name])
