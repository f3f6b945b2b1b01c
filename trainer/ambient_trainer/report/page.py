"""A report is a folder: ``index.html`` and plotly's script beside it. It opens from a disk, with no network."""

from __future__ import annotations

import os
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from plotly.offline import get_plotlyjs  # type: ignore[import-untyped]

from ambient_model import __version__
from ambient_model.atomic import replacing
from ambient_model.faults import refuse

PAGE = "index.html"
SCRIPT = "plotly.min.js"


def render(template: str, **content: Any) -> str:
    """The page that ``template`` (a file in ``report/templates``) makes of ``content``; all text is escaped."""
    environment = Environment(
        loader=PackageLoader("ambient_trainer.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(script=SCRIPT, version=__version__, **content)


def write_report(folder: str, page: str) -> str:
    """Write ``page`` and what it needs into ``folder``, made where missing, and return the page's path.

    Each file is replaced whole or left as it was. Raises :class:`Refused` where the folder cannot be written to.
    """
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise refuse(
            folder, "", f"cannot be made a folder ({error.strerror})", "name another folder for the report"
        ) from error
    with replacing(os.path.join(folder, SCRIPT)) as stream:
        stream.write(get_plotlyjs())
    path = os.path.join(folder, PAGE)
    with replacing(path) as stream:
        stream.write(page)
    return path
