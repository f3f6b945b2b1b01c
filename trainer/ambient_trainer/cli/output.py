"""What a command shows and writes: its report on the terminal, as JSON and as a page."""

from __future__ import annotations

import click
from rich.console import Console

from ambient_trainer.report import Report
from ambient_trainer.report.machine import write_json
from ambient_trainer.report.terminal import print_report

_WIDTH_OF_A_FILE = 140


def printer() -> Console:
    """Standard output, as wide as the terminal is; in a file as wide as the tables are."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _WIDTH_OF_A_FILE
    return console


def show(report: Report, json_path: str | None = None, report_folder: str | None = None) -> None:
    """Print ``report``, and write its data and its page where they are asked for."""
    print_report(printer(), report)
    if json_path is not None:
        write_json(json_path, report.data)
        click.echo(f"Figures: {json_path}")
    if report_folder is not None:
        from ambient_trainer.report.page import write_report  # jinja2: only a page should wait for it

        click.echo(f"Report: {write_report(report_folder, report)}")
