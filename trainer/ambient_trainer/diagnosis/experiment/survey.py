"""What to do where nothing explains the misfit: one thing switched at a time, and what goes on beside it noted."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.experiment.plan import bench_of
from ambient_trainer.diagnosis.experiment.sentence import listed, rest, span, switching
from ambient_trainer.diagnosis.selection import Selection
from ambient_trainer.diagnosis.words import digits

_CONSTANTS = 3.0
_SHORTEST_S, _LONGEST_S = 600.0, 4 * 3600.0


def survey(selection: Selection) -> str:
    """Rest, then every drive alone for three of the slowest time constants; the sensor to watch is the one most off."""
    views = selection.final.views
    plant = views[0].plant
    bench = bench_of(views, list(views[0].signals))
    left = np.concatenate([view.residual_degC for view in views], axis=1)
    off_degC = [_rms(row) for row in left]
    worst = int(np.argmax(off_degC))
    slowest_s = _CONSTANTS / float(-plant.rates.max())
    each_s = 60.0 * math.ceil(min(max(slowest_s, _SHORTEST_S), _LONGEST_S) / 60.0)
    steps = [switching(drive.column, drive.rest, drive.levels[0]) for drive in bench.drives if drive.levels]
    steps += [switching(name, level, level + 10.0) for name, level in bench.temperatures_degC.items()]
    return (
        f"{rest(bench)}. Then, one at a time and back again, for {span(each_s)} each, {listed(steps)}, and log what"
        f" else goes on at `{plant.sensors[worst]}`, where {digits(off_degC[worst], 2)} degC are unexplained: what"
        " is wrong at rest already is an instrument or an unlogged source, what comes with one switch goes with it."
    )


def _rms(row: NDArray[np.float64]) -> float:
    known = row[~np.isnan(row)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
