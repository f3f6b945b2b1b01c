"""The one structure of what a command shows, on a terminal, to a machine or as a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]

Status = Literal["plain", "result", "good", "warning", "bad"]


@dataclass(frozen=True)
class Finding:
    """A sentence and what it means for the reader.

    Parameters
    ----------
    text : str
        The sentence. What stands between backquotes is code; ``degC`` becomes °C on a page.
    status : {"plain", "result", "good", "warning", "bad"}
        ``result`` is the main answer, ``warning`` is read before any figure is trusted.
    label : str
        A word or two before the sentence, such as a cause's name.
    value : str
        A figure that the sentence explains; the page shows it large.
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

    draw: Callable[[], go.Figure]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """Blocks under a heading; a section among the blocks is one level below.

    Parameters
    ----------
    title : str
        The heading; may be empty.
    blocks : sequence of Finding, Facts, Table, Figure, Section, str or None
        In the order to read them. A ``str`` is a note, for pages only; None and an empty ``str`` are left out.
    detail : bool
        The page shows it, the terminal does not.
    fold : {"", "open", "closed"}
        Whether the reader of a page can fold it, and how it starts.
    """

    title: str
    blocks: Sequence[Block | None]
    detail: bool = False
    fold: Literal["", "open", "closed"] = ""


Block: TypeAlias = Finding | Facts | Table | Figure | Section | str


@dataclass(frozen=True)
class Report:
    """What a result says, for people and for machines.

    Parameters
    ----------
    title : str
        The result in one short line, with its figure.
    lead : sequence of Finding, Facts, Table, Figure, str or None
        What to read first: the main finding, warnings, facts about the data.
    sections : sequence of Section
        The rest, in the order to read it.
    data : mapping
        Exactly what ``--json`` writes.
    subject : str
        The kind of report, such as ``Model evaluation``; a page shows it above the title.
    footnotes : sequence of str
        How to read the figures; pages only.
    """

    title: str
    lead: Sequence[Block | None]
    sections: Sequence[Section]
    data: Mapping[str, Any] = field(repr=False)
    subject: str = ""
    footnotes: Sequence[str] = ()
