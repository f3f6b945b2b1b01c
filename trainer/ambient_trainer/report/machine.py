"""A report for a machine: one JSON object, written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from ambient_model.atomic import replacing


def write_json(path: str, data: Mapping[str, Any]) -> None:
    """Write ``data`` as JSON; raises :class:`ValueError` where a number is not finite."""
    with replacing(path) as stream:
        json.dump(data, stream, indent=1, allow_nan=False)
        stream.write("\n")
