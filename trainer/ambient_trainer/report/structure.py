"""The one structure of what a command shows, on a terminal, to a machine or as a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

Plot: TypeAlias = Any
"""A plotly figure. Only a page waits for plotly: no module imports it at its top."""
Status = Literal["plain", "result", "good", "warning", "bad"]


@dataclass(frozen=True)
class Finding:
    """A sentence and what it means for the reader.

    In ``text``, what stands between backquotes is code; ``degC`` becomes °C on a page. The status ``result`` marks the
    main answer, ``warning`` what to read before any figure is trusted. The ``label`` stands before the sentence, and
    ``value`` is a figure that it explains; the page shows it large.
    """

    text: str
    status: Status = "plain"
    label: str = ""
    value: str = ""


@dataclass(frozen=True)
class Facts:
    """Names and values about the data and the settings; a value may have several lines. Pages only."""

    pairs: Sequence[tuple[str, str | Sequence[str]]]


@dataclass(frozen=True)
class Table:
    """Rows of text; the first ``labels`` columns name the row, the others are figures."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    labels: int = 1


@dataclass(frozen=True)
class Figure:
    """A plot; ``draw`` is called by the page only, so that nothing else imports plotly."""

    draw: Callable[[], Plot]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """Blocks under a heading, which may be empty; a section among the blocks is one level below.

    A ``str`` among the blocks is a note, for pages only; None and an empty ``str`` are left out. What is ``detail`` is
    not for the terminal; what has a ``fold`` can be folded on a page, and starts so.
    """

    title: str
    blocks: Sequence[Block | None]
    detail: bool = False
    fold: Literal["", "open", "closed"] = ""


Block: TypeAlias = Finding | Facts | Table | Figure | Section | str


@dataclass(frozen=True)
class Report:
    """What a result says, for people and for machines.

    The ``title`` is the result in one short line, with its figure; ``lead`` is what to read first: the main finding,
    warnings, facts about the data. ``data`` is exactly what ``--json`` writes. A page has the ``subject``, the kind of
    report, above the title, and ``footnotes`` on how to read the figures.
    """

    title: str
    lead: Sequence[Block | None]
    sections: Sequence[Section]
    data: Mapping[str, Any] = field(repr=False)
    subject: str = ""
    footnotes: Sequence[str] = ()
