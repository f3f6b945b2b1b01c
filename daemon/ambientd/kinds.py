"""Kinds of publishers and sources: each is one module of its package, found by its name and imported when asked for.

What makes a module a kind is a function that its package names; the modules beside it are helpers. A hyphen in a kind
is an underscore in its module's name.
"""

import sys
from typing import Any


def module_of(package: str, kind: Any, function: str) -> Any | None:
    """The module in ``package`` of the kind named ``kind``; None where there is none."""
    name = kind.replace("-", "_") if isinstance(kind, str) else ""
    if not (name.isascii() and name.isidentifier()):
        return None
    try:
        __import__(f"{package}.{name}")
    except ModuleNotFoundError as error:
        if error.name == f"{package}.{name}":
            return None
        raise
    module = sys.modules[f"{package}.{name}"]
    return module if hasattr(module, function) else None


def known(package: str, function: str) -> dict[str, Any]:
    """Every kind in ``package``, by name. It imports them all: for messages and help only."""
    import pkgutil  # a daemon with a valid configuration does without

    names = [each.name for each in pkgutil.iter_modules(__import__(package, fromlist=["*"]).__path__)]
    found = {name: module_of(package, name, function) for name in sorted(names)}
    return {name.replace("_", "-"): module for name, module in found.items() if module is not None}
