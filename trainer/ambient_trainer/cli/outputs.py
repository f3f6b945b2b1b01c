"""What a command is about to write is looked at before it starts: no input is overwritten, no long work is in vain."""

from __future__ import annotations

import os
from collections.abc import Sequence

import click

from ambient_model.faults import Fault

_OF_A_REPORT = ("index.html", "plotly.min.js")
"""As ``report/page.py`` names them, which takes half a second to import."""


def check_outputs(
    outputs: Sequence[str | None], inputs: Sequence[str], report: str | None = None, folder: str | None = None
) -> None:
    """Refuse outputs that stand twice, are inputs, or lie where nothing can be written; None is one not asked for.

    ``report`` is the folder of a page: it may have to be made, and what it will hold are outputs, too;
    ``folder`` is one for files whose names the work decides.
    Raises :class:`click.UsageError` naming every such output.
    """
    pages = [] if report is None else [os.path.join(report, name) for name in _OF_A_REPORT]
    files = [path for path in outputs if path is not None]
    wanted = [*files, *pages]
    faults = []
    for index, path in enumerate(wanted):
        if any(_same(path, other) for other in inputs):
            faults.append(Fault(path, "would be overwritten by what is made from it", "name another output"))
        elif any(_same(path, other) for other in wanted[:index]):
            faults.append(Fault(path, "stands twice among the outputs", "give each a name of its own"))
        elif problem := _no_file(path) or (_no_place(path) if index < len(files) else None):
            faults.append(Fault(path, *problem))
    for place, purpose in ((report, "the report"), (folder, "these files")):
        if place is not None and (problem := _no_folder(place, purpose)):
            faults.append(Fault(place, *problem))
    if faults:
        raise click.UsageError("\n".join(map(str, faults)))


def _same(one: str, other: str) -> bool:
    if os.path.exists(one) and os.path.exists(other):
        return os.path.samefile(one, other)
    return os.path.realpath(one) == os.path.realpath(other)


def _no_file(path: str) -> tuple[str, str] | None:
    if os.path.isdir(os.path.realpath(path)):  # no name at all is this folder's
        return "is a folder", "name a file in it"
    if os.path.exists(path) and not os.path.isfile(path):
        return "is a device", "name a file"
    return None


def _no_place(path: str) -> tuple[str, str] | None:
    folder = os.path.dirname(os.path.realpath(path))
    if not os.path.isdir(folder):
        return f"there is no folder {folder}", "make it first, or name another"
    return _closed(folder)


def _no_folder(path: str, purpose: str) -> tuple[str, str] | None:
    """Why ``path`` neither is a folder to write into nor can be made one."""
    whole = there = os.path.abspath(path)
    while not os.path.lexists(there):
        there = os.path.dirname(there)
    if os.path.isdir(there):
        return _closed(there)
    problem = "is no folder" if there == whole else f"cannot be made: {there} is no folder"
    return problem, f"name another folder for {purpose}"


def _closed(folder: str) -> tuple[str, str] | None:
    if os.access(folder, os.W_OK):
        return None
    return f"nothing can be written into {folder}", "choose a folder that you may write to"
