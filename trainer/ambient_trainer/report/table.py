"""A table is text in cells, written once and shown twice: on the terminal and on a page."""

from __future__ import annotations

from dataclasses import dataclass

import rich.table
from rich import box
from rich.text import Text

_NARROWEST_LABEL = 8


@dataclass(frozen=True)
class Table:
    """Rows of text; the first ``labels`` columns name the row, the others are figures."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    labels: int = 1


def for_terminal(table: Table) -> rich.table.Table:
    """``table`` as rich prints it; what stands in a cell is never taken as markup."""
    shown = rich.table.Table(
        caption=Text(table.caption) if table.caption else None,
        caption_justify="left",
        header_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    for index, column in enumerate(table.columns):
        if index < table.labels:
            # a narrow terminal folds a name; figures stay on one line
            shown.add_column(Text(column), overflow="fold", min_width=_NARROWEST_LABEL)
        else:
            shown.add_column(Text(column), justify="right", no_wrap=True)
    for row in table.rows:
        shown.add_row(*map(Text, row))
    return shown
