"""The status table: who speaks, and what its estimate is called. It knows no clock, no file and no number.

An estimator by itself is ``tracking`` while all its inputs are there, ``warming_up`` until it has settled, ``degraded``
while its guard has a say, ``coasting`` while last values may stand in for inputs that are missing, and ``faulted``
after that. What is published follows from the main one's status and from what the fallbacks, which do without one input
each and have no guard, have to offer. A main one that has not settled is ``warming_up`` here, guard or not: it starts
from an equilibrium that the device may be far from, and a fallback that has been speaking knows better.
"""

from collections.abc import Sequence

from ambient_model.tracking import COASTING, DEGRADED, FAULTED, TRACKING, WARMING_UP

MAIN = 0
"""Who speaks: this, or the number of a fallback, from 1."""
SETTLED = "settled"
"""The fallback that was heard last has all its inputs and has settled."""
COMPLETE = "complete"
"""That one has not, but a fallback has all its inputs."""
STANDING_IN = "standing in"
"""None has, but in the one that was heard last a last value stands in."""
NOTHING = "nothing"

TABLE = {
    (TRACKING, SETTLED): ("main", TRACKING),
    (TRACKING, COMPLETE): ("main", TRACKING),
    (TRACKING, STANDING_IN): ("main", TRACKING),
    (TRACKING, NOTHING): ("main", TRACKING),
    (WARMING_UP, SETTLED): ("heard", DEGRADED),
    (WARMING_UP, COMPLETE): ("main", WARMING_UP),
    (WARMING_UP, STANDING_IN): ("main", WARMING_UP),
    (WARMING_UP, NOTHING): ("main", WARMING_UP),
    (DEGRADED, SETTLED): ("main", DEGRADED),
    (DEGRADED, COMPLETE): ("main", DEGRADED),
    (DEGRADED, STANDING_IN): ("main", DEGRADED),
    (DEGRADED, NOTHING): ("main", DEGRADED),
    (COASTING, SETTLED): ("first", DEGRADED),
    (COASTING, COMPLETE): ("first", DEGRADED),
    (COASTING, STANDING_IN): ("heard", COASTING),
    (COASTING, NOTHING): ("main", COASTING),
    (FAULTED, SETTLED): ("first", DEGRADED),
    (FAULTED, COMPLETE): ("first", DEGRADED),
    (FAULTED, STANDING_IN): ("heard", COASTING),
    (FAULTED, NOTHING): ("main", FAULTED),
}
"""By the main one's status and the offer of the fallbacks: who speaks, and the status that is published.

Who speaks is the main one, the fallback that was heard last, or the first fallback that has all its inputs.
"""


def has_all_inputs(status: str) -> bool:
    """Whether an estimator that says this of itself has all its inputs."""
    return status in (TRACKING, WARMING_UP, DEGRADED)


def decide(main: str, fallbacks: Sequence[str], heard: int) -> tuple[int, str]:
    """Who speaks now and with which status, from each estimator's own status and who was ``heard`` last."""
    complete = [number for number, status in enumerate(fallbacks, 1) if has_all_inputs(status)]
    who, status = TABLE[main, _offer(NOTHING if heard == MAIN else fallbacks[heard - 1], bool(complete))]
    if who == "main":
        return MAIN, status
    return (heard if who == "heard" else complete[0]), status


def _offer(heard: str, complete: bool) -> str:
    """From the status of the fallback that was ``heard`` last, and whether one has all its inputs."""
    if heard == TRACKING:
        return SETTLED
    if complete:
        return COMPLETE
    return STANDING_IN if heard == COASTING else NOTHING
