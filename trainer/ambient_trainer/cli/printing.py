"""What commands without a :class:`Report` show; goes when none is left."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

from ambient_trainer.cli.output import printer
from ambient_trainer.report.machine import write_json

__all__ = ["printer", "write_figures", "write_json", "write_page"]


def write_figures(path: str, data: Mapping[str, Any]) -> None:
    """Write ``data`` as JSON, whole or not at all, and say so."""
    write_json(path, data)
    click.echo(f"Figures: {path}")


def write_page(folder: str, page: str) -> None:
    """Write a report's page into ``folder``, and say where it is."""
    from ambient_trainer.report.page import write_report  # jinja2: only a report should wait for it

    click.echo(f"Report: {write_report(folder, page)}")
