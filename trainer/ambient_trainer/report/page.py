"""A report as a page: a folder with ``index.html`` and plotly's script beside it. It needs no network.

All text is escaped here and nowhere else; what stands between backquotes becomes code, and ``degC`` becomes °C.
"""

import itertools
import re
from collections.abc import Iterator, Sequence
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from ambient_model import __version__
from ambient_model.atomic import replacing
from ambient_trainer.report.files import PAGE, SCRIPT, made_folder
from ambient_trainer.report.palette import on_dark
from ambient_trainer.report.plots import POINTS_PER_LINE, to_markup
from ambient_trainer.report.structure import Block, Facts, Figure, Finding, Report, Section, Table

_CONTENTS_FROM = 6
"""Sections of a page that links to each of them from its top; fewer are seen by scrolling."""
_KINDS = {Facts: "facts", Table: "table", Figure: "figure", Section: "section", str: "note"}


def page_of(report: Report) -> str:
    """``report`` as HTML."""
    numbers = itertools.count(1)
    sections = [(each, parts) for each in report.sections if (parts := list(_parts(each.blocks, numbers)))]
    strict: dict[str, Any] = {"undefined": StrictUndefined, "trim_blocks": True, "lstrip_blocks": True}
    environment = Environment(loader=PackageLoader("ambient_trainer.report"), autoescape=True, **strict)
    environment.filters["text"] = _text
    return environment.get_template("report.html").render(
        report=report,
        lead=list(_parts(report.lead, numbers)),
        sections=sections,
        contents=[each.title for each, _ in sections] if len(sections) >= _CONTENTS_FROM else [],
        figures=next(numbers) > 1,
        points=f"{POINTS_PER_LINE:,}",
        colours=on_dark(),
        script=SCRIPT,
        version=__version__,
    )  # fmt: skip


def write_report(folder: str, report: Report) -> str:
    """Write the page of ``report`` and what it needs into ``folder``, made where missing, and return the page's path.

    Each file is replaced whole or left as it was. Raises :class:`Refused` where the folder cannot be written to.
    """
    from plotly.offline import get_plotlyjs  # type: ignore[import-untyped]

    page = page_of(report)
    place = made_folder(folder)
    for name, text in ((SCRIPT, get_plotlyjs()), (PAGE, page)):
        with replacing(str(place / name)) as stream:
            stream.write(text)
    return str(place / PAGE)


def _parts(blocks: Sequence[Block | None], numbers: Iterator[int]) -> Iterator[tuple[str, Any]]:
    """What the template draws one after the other: its kind and its content; findings of one kind are grouped."""
    for kind, run in itertools.groupby((each for each in blocks if each), _kind):
        if kind in ("tiles", "points"):
            yield kind, list(run)
            continue
        for each in run:
            if isinstance(each, Figure):
                yield kind, (to_markup(each.draw(), f"figure-{next(numbers)}"), each.caption)
            elif isinstance(each, Section):
                if parts := list(_parts(each.blocks, numbers)):
                    yield kind, (each, parts)
            else:
                yield kind, each


def _kind(block: Block) -> str:
    if isinstance(block, Finding):
        if block.value:
            return "tiles"
        return "points" if block.status == "plain" and not block.label else "finding"
    return _KINDS[type(block)]


def _text(text: str) -> Markup:
    # °C for degC, but in a column's name such as ``usb_degC``
    parts = re.split("`([^`]*)`", text)
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if index % 2 else escape(re.sub(r"(?<!\w)degC\b", "°C", part))
        for index, part in enumerate(parts)
    )
