"""A report on a terminal: its title, findings and tables; figures, facts and notes are for the page."""

from collections.abc import Sequence
from typing import Any

import rich.table
from rich import box
from rich.console import Console
from rich.panel import Panel
from rich.text import Text

from ambient_trainer.report.structure import Block, Finding, Report, Section, Table

_NARROWEST_LABEL = 8
_STYLES = {"plain": "", "result": "bold", "good": "green", "warning": "bold yellow", "bad": "bold red"}


def print_report(console: Console, report: Report) -> None:
    """Print ``report``; no text in it is taken as markup."""
    console.print(Text(report.title, style="bold"), soft_wrap=True)
    _print_blocks(console, report.lead)
    _print_blocks(console, report.sections)


def for_terminal(table: Table) -> rich.table.Table:
    """``table`` as rich prints it; what stands in a cell is never taken as markup."""
    look: dict[str, Any] = {"box": box.SIMPLE_HEAD, "pad_edge": False, "collapse_padding": True}
    caption = Text(table.caption) if table.caption else None
    shown = rich.table.Table(caption=caption, caption_justify="left", header_style="bold", **look)
    for index, column in enumerate(table.columns):
        if index < table.labels:
            # a narrow terminal folds a name; figures stay on one line
            shown.add_column(Text(column), overflow="fold", min_width=_NARROWEST_LABEL)
        else:
            shown.add_column(Text(column), justify="right", no_wrap=True)
    for row in table.rows:
        shown.add_row(*map(Text, row))
    return shown


def _print_blocks(console: Console, blocks: Sequence[Block | None]) -> None:
    for each in blocks:
        if isinstance(each, Table):
            console.print(for_terminal(each))
        elif isinstance(each, Finding):
            text = " ".join(filter(None, [each.label and f"{each.label}:", each.value, each.text]))
            if each.status == "warning":
                console.print(Panel(Text(text, style="bold"), border_style="red", expand=False))
            else:
                console.print(Text(text, style=_STYLES[each.status]), soft_wrap=True)
        elif isinstance(each, Section) and _has_text(each):
            if each.title:
                console.print(Text(f"\n{each.title}", style="bold"), soft_wrap=True)
            _print_blocks(console, each.blocks)


def _has_text(block: Block | None) -> bool:
    if isinstance(block, Section):
        return not block.detail and any(map(_has_text, block.blocks))
    return isinstance(block, Table | Finding)
