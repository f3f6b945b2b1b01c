"""The active estimator and the published status. It knows no clock, no file and no number.

An estimator by itself is ``tracking`` while all its inputs are there, ``warming_up`` until it has settled, ``degraded``
while the secondary estimate is blended in, ``coasting`` while last values replace missing inputs, and ``faulted`` after
that. The published status follows from the main one's and the fallbacks', which do without one input each and have no
secondary estimator. A main one that has not settled counts as ``warming_up`` here: it starts from an equilibrium that
the device may be far from, and an active fallback that has settled is better.
"""

from collections.abc import Sequence

from ambient_model.tracking import COASTING, DEGRADED, TRACKING, WARMING_UP

ALL_INPUTS = frozenset((TRACKING, WARMING_UP, DEGRADED))
"""The statuses of an estimator that has all its inputs."""
MAIN = 0
"""The active estimator: this, or the number of a fallback, from 1."""


def decide(main: str, fallbacks: Sequence[str], active: int) -> tuple[int, str]:
    """The estimator to publish and the status, from each estimator's own status and the one ``active`` last."""
    last = None if active == MAIN else fallbacks[active - 1]
    if main == WARMING_UP and last == TRACKING:
        return active, DEGRADED
    if main in ALL_INPUTS:
        return MAIN, main
    for number, status in enumerate(fallbacks, 1):
        if status in ALL_INPUTS:
            return number, DEGRADED
    return (active, COASTING) if last == COASTING else (MAIN, main)
