"""Every colour of a plot, by what it stands for; each has a counterpart for a dark page."""

import zlib
from collections.abc import Iterable

BLUE, INK, ORANGE, SKY, SAND = "#1d5fbf", "#111827", "#c2410c", "#7cb8f2", "#c4ad78"
RED, AMBER, TEAL, VIOLET, GREY, LIGHT = "#dc2626", "#e3a008", "#0d9488", "#8b5cf6", "#6b7280", "#c4c9d1"

ESTIMATE, REFERENCE, ERROR, INTERVAL, BASELINE = BLUE, INK, ORANGE, SKY, SAND
MEASURED, SIMULATED, EXTENDED = INK, ORANGE, BLUE
"""Of a circuit that is simulated forward; ``EXTENDED`` is the circuit with what was missing."""
LIMIT = RED
"""A line that must not be crossed."""

SENSOR_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#6b7281", "#7a5195")
"""Of Okabe and Ito, who chose them for the colour-blind, with a grey and a violet in place of yellow and black."""
STEP_COLOURS = (BLUE, "#009e73", "#7a5195", "#cc79a7")
"""Of effects that are added one after the other."""
SHADE_COLOURS = (AMBER, "#009e73", "#7a5195", "#cc79a7")
"""Of stretches of time."""

GRID, AXIS, TEXT = "#e5e7eb", "#9ca3af", "#1f2937"

_ON_DARK = {
    BLUE: "#6ba4f5", INK: "#f3f4f6", ORANGE: "#f28b55", SKY: "#3f78b5", SAND: "#a8925e",
    RED: "#f87171", AMBER: "#f0b429", TEAL: "#2dd4bf", VIOLET: "#a78bfa",
    GREY: "#9aa3b2", LIGHT: "#5b6472", GRID: "#2b3442", AXIS: "#5d6878", TEXT: "#e5e7eb",
    "#0072b2": "#4aa8e0", "#d55e00": "#f5853f", "#009e73": "#33c79b", "#cc79a7": "#dc97bd",
    "#e69f00": "#f0b840", "#56b4e9": "#7cc6f0", "#6b7281": "#a3abb8", "#7a5195": "#b08ccb",
}  # fmt: skip

DIVERGING = (
    (0, "rgba(194,65,12,0.6)"), (0.5, "rgba(194,65,12,0)"), (0.5, "rgba(29,95,191,0)"), (1, "rgba(29,95,191,0.6)")
)  # fmt: skip
"""From less than 0 through nothing to more than 0; half transparent, so that text on it is read on any page."""


def sensor_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour for each of ``names``, the same in every plot as far as the colours last."""
    colours: dict[str, str] = {}
    count = len(SENSOR_COLOURS)
    for number, name in enumerate(sorted(set(names))):
        first = zlib.crc32(name.encode())
        order = [SENSOR_COLOURS[(first + step) % count] for step in range(count)]
        free = [colour for colour in order if colour not in colours.values()]
        colours[name] = free[0] if number < count else order[0]
    return colours


def on_dark() -> list[tuple[str, str]]:
    """Pairs of a colour as a browser writes it in a style, ``rgb(29, 95, 191)``, and its counterpart."""
    rgb = {light: [str(int(light[start : start + 2], 16)) for start in (1, 3, 5)] for light in _ON_DARK}
    return [(f"rgb({', '.join(rgb[light])})", dark) for light, dark in _ON_DARK.items()]
