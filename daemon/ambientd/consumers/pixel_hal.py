"""The Pixel thermal HAL: sensors with a ``TempPath``, whose thresholds go from light to shutdown."""

import json
import os
from typing import Any

from ambientd.consumers import Reading

_SHUTDOWN = 6


def reads(root: str) -> list[Reading]:
    """Each file that its configuration names."""
    try:
        with open(os.path.join(root, "vendor/etc/thermal_info_config.json"), encoding="utf-8") as stream:
            sensors: Any = json.load(stream)["Sensors"]
        return [_reading(each) for each in sensors if "TempPath" in each]
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return []


def _reading(sensor: dict[str, Any]) -> Reading:
    scale = float(sensor.get("Multiplier", 1.0))
    thresholds = [float(each) / scale for each in sensor.get("HotThreshold", [])]
    given = [round(each) for each in thresholds[:_SHUTDOWN] if each == each]  # NAN is not itself
    shut_down = [round(each) for each in thresholds[_SHUTDOWN:] if each == each]
    missing = "keeps its last severity without a file"
    return Reading(sensor["TempPath"], "system", max(given, default=None), min(shut_down, default=None), missing)
