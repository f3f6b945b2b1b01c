"""Traces as arrays: read, cut, imported from other formats, laid on a uniform grid.

The names below are imported when they are first used: ``ambient-trainer --help`` looks for plug-ins here, and must not
wait for numpy.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ambient_trainer.data.grid import Segment, sampling_period_s, segments
    from ambient_trainer.data.plugins import plugin, plugin_names
    from ambient_trainer.data.resolution import noise_of, resolution_of, rounded
    from ambient_trainer.data.trace import Array, Trace, load_trace, save_trace

_PLACES = {
    **dict.fromkeys(("Segment", "sampling_period_s", "segments"), "grid"),
    **dict.fromkeys(("plugin", "plugin_names"), "plugins"),
    **dict.fromkeys(("noise_of", "resolution_of", "rounded"), "resolution"),
    **dict.fromkeys(("Array", "Trace", "load_trace", "save_trace"), "trace"),
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)
