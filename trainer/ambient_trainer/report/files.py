"""The files of a report: what a page's are called, and the JSON object for a machine. Light: every command needs it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ambient_model.atomic import replacing
from ambient_model.faults import refuse

PAGE = "index.html"
SCRIPT = "plotly.min.js"


def made_folder(folder: str) -> Path:
    """The folder, made where missing; raises :class:`Refused` where it cannot be."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refuse(folder, "", f"cannot be made a folder ({error.strerror})", "name another folder") from error
    return Path(folder)


def finite(data: Mapping[str, Any]) -> dict[str, Any]:
    """As JSON has it: null where a number is not finite."""
    return dict(json.loads(json.dumps(data), parse_constant=lambda name: None))


def write_json(path: str, data: Mapping[str, Any]) -> None:
    """Write ``data`` whole or not at all; raises :class:`ValueError` where a number is not finite."""
    with replacing(path) as stream:
        json.dump(data, stream, indent=1, allow_nan=False)
        stream.write("\n")
