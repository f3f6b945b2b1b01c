"""The status table: who speaks, and what its estimate is called. It knows no clock, no file and no number.

An estimator by itself is ``tracking`` while all its inputs are there, ``warming_up`` until it has settled, ``degraded``
while its guard has a say, ``coasting`` while last values may stand in for inputs that are missing, and ``faulted``
after that. What is published follows from the main one's status and from what the fallbacks, which do without one input
each and have no guard, have to offer.
"""

from collections.abc import Sequence

from ambient_model.tracking import COASTING, DEGRADED, FAULTED, TRACKING, WARMING_UP

MAIN = 0
"""Who speaks: this, or the number of a fallback, from 1."""
COMPLETE = "complete"
"""A fallback has all its inputs."""
STANDING_IN = "standing in"
"""None has, but in the one that was heard last a last value stands in."""
NOTHING = "nothing"

TABLE = {
    (TRACKING, COMPLETE): ("main", TRACKING),
    (TRACKING, STANDING_IN): ("main", TRACKING),
    (TRACKING, NOTHING): ("main", TRACKING),
    (WARMING_UP, COMPLETE): ("main", WARMING_UP),
    (WARMING_UP, STANDING_IN): ("main", WARMING_UP),
    (WARMING_UP, NOTHING): ("main", WARMING_UP),
    (DEGRADED, COMPLETE): ("main", DEGRADED),
    (DEGRADED, STANDING_IN): ("main", DEGRADED),
    (DEGRADED, NOTHING): ("main", DEGRADED),
    (COASTING, COMPLETE): ("fallback", DEGRADED),
    (COASTING, STANDING_IN): ("fallback", COASTING),
    (COASTING, NOTHING): ("main", COASTING),
    (FAULTED, COMPLETE): ("fallback", DEGRADED),
    (FAULTED, STANDING_IN): ("fallback", COASTING),
    (FAULTED, NOTHING): ("main", FAULTED),
}
"""By the main one's status and the offer of the fallbacks: who speaks, and the status that is published."""


def has_all_inputs(status: str) -> bool:
    """Whether an estimator that says this of itself has all its inputs."""
    return status in (TRACKING, WARMING_UP, DEGRADED)


def decide(main: str, fallbacks: Sequence[str], heard: int) -> tuple[int, str]:
    """Who speaks now and with which status, from each estimator's own status and who was ``heard`` last."""
    offer, number = _offer(fallbacks, heard)
    who, status = TABLE[main, offer]
    return (MAIN if who == "main" else number), status


def _offer(fallbacks: Sequence[str], heard: int) -> tuple[str, int]:
    for number, status in enumerate(fallbacks, 1):
        if has_all_inputs(status):
            return COMPLETE, number
    if heard != MAIN and fallbacks[heard - 1] == COASTING:
        return STANDING_IN, heard
    return NOTHING, MAIN
