"""What a command is about to write is looked at before it starts: no input is overwritten, no long work is in vain."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import click

from ambient_model.faults import Fault


def check_outputs(outputs: Sequence[str | None], inputs: Sequence[str]) -> None:
    """Refuse outputs that stand twice, are inputs, or lie where nothing can be written; None is one not asked for.

    Raises :class:`click.UsageError` naming every such output.
    """
    wanted = [path for path in outputs if path is not None]
    faults = []
    for index, path in enumerate(wanted):
        if any(_same(path, other) for other in inputs):
            faults.append(Fault(path, "would be overwritten by what is made from it", "name another output"))
        elif any(_same(path, other) for other in wanted[:index]):
            faults.append(Fault(path, "stands twice among the outputs", "give each a name of its own"))
        elif problem := _unwritable(path):
            faults.append(Fault(path, *problem))
    if faults:
        raise click.UsageError("\n".join(map(str, faults)))


def _same(one: str, other: str) -> bool:
    if os.path.exists(one) and os.path.exists(other):
        return os.path.samefile(one, other)
    return os.path.realpath(one) == os.path.realpath(other)


def _unwritable(path: str) -> tuple[str, str] | None:
    folder = Path(os.path.realpath(path)).parent
    if os.path.isdir(path):
        return "is a folder", "name a file in it"
    if not folder.is_dir():
        return f"there is no folder {folder}", "make it first, or name another"
    if not os.access(folder, os.W_OK):
        return f"nothing can be written into {folder}", "choose a folder that you may write to"
    return None
