"""Output of a command: its report on the terminal, as JSON and as a page.

Everything that a command is about to write is looked at before it starts: no input is overwritten, no long work is in
vain.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import click
from rich.console import Console

from ambient_model.faults import Fault
from ambient_trainer.report import Report
from ambient_trainer.report.files import PAGE, SCRIPT, write_json
from ambient_trainer.report.terminal import print_report

_WIDTH_OF_A_FILE = 140


@dataclass(frozen=True)
class Output:
    """Where the report of a command goes beside the terminal."""

    json_path: str | None = None
    report_folder: str | None = None

    def check(self, inputs: Sequence[str], files: Sequence[str | None] = (), folder: str | None = None) -> None:
        """Refuse the call where these outputs or ``files`` are duplicated, are ``inputs``, or cannot be written.

        Outputs that are None were not asked for. What goes into ``folder`` is named by the work.
        """
        page = self.report_folder
        named = [path for path in (self.json_path, *files) if path is not None]
        wanted = [*named, *(os.path.join(page, name) for name in (PAGE, SCRIPT) if page is not None)]
        faults = []
        for index, path in enumerate(wanted):
            if any(_same(path, other) for other in inputs):
                faults.append(Fault(path, "would be overwritten by what is made from it", "name another output"))
            elif any(_same(path, other) for other in wanted[:index]):
                faults.append(Fault(path, "is named twice among the outputs", "give each a name of its own"))
            elif problem := _no_file(path, in_place=index < len(named)):
                faults.append(Fault(path, *problem))
        for place, purpose in ((page, "the report"), (folder, "these files")):
            if place is not None and (problem := _no_folder(place, purpose)):
                faults.append(Fault(place, *problem))
        if faults:
            raise click.UsageError("\n".join(map(str, faults)))

    def show(self, report: Report) -> None:
        """Write the data and the page of ``report`` where they are asked for, and print it.

        In this order: whoever closes the output early, as ``head`` does, still has the files.
        """
        written = []
        if self.json_path is not None:
            write_json(self.json_path, report.data)
            written.append(f"Figures: {self.json_path}")
        if self.report_folder is not None:
            from ambient_trainer.report.page import write_report  # jinja2: only a page should wait for it

            written.append(f"Report: {write_report(self.report_folder, report)}")
        print_report(printer(), report)
        for line in written:
            click.echo(line)


def printer() -> Console:
    """Standard output, as wide as the terminal is; in a file as wide as the tables are."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _WIDTH_OF_A_FILE
    return console


def _same(one: str, other: str) -> bool:
    if os.path.exists(one) and os.path.exists(other):
        return os.path.samefile(one, other)
    return os.path.realpath(one) == os.path.realpath(other)


def _no_file(path: str, in_place: bool) -> tuple[str, str] | None:
    """Why ``path`` cannot be a file; ``in_place``: in a folder that has to be there."""
    folder = os.path.dirname(os.path.realpath(path))
    if os.path.isdir(os.path.realpath(path)):  # no name at all is this folder's
        return "is a folder", "name a file in it"
    if os.path.exists(path) and not os.path.isfile(path):
        return "is a device", "name a file"
    if in_place and not os.path.isdir(folder):
        return f"there is no folder {folder}", "make it first, or name another"
    return _closed(folder) if in_place else None


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
