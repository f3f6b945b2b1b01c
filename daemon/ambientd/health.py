"""The status table: the active estimator and the published status. It knows no clock, no file and no number.

An estimator by itself is ``tracking`` while all its inputs are there, ``warming_up`` until it has settled, ``degraded``
while the secondary estimate is blended in, ``coasting`` while last values replace missing inputs, and ``faulted`` after
that. The published status follows from the main one's and the fallbacks', which do without one input each and have no
secondary estimator. A main one that has not settled counts as ``warming_up`` here: it starts from an equilibrium that
the device may be far from, and an active fallback that has settled is better.
"""

from collections.abc import Sequence

from ambient_model.tracking import COASTING, DEGRADED, FAULTED, TRACKING, WARMING_UP

ALL_INPUTS = frozenset((TRACKING, WARMING_UP, DEGRADED))
"""The statuses of an estimator that has all its inputs."""
MAIN = 0
"""The active estimator: this, or the number of a fallback, from 1."""
SETTLED = "settled"
"""The fallback that was active last has all its inputs and has settled."""
COMPLETE = "complete"
"""That one has not, but a fallback has all its inputs."""
STANDING_IN = "standing in"
"""None has, but the one that was active last coasts."""
NOTHING = "nothing"

TABLE = {
    (TRACKING, SETTLED): ("main", TRACKING),
    (TRACKING, COMPLETE): ("main", TRACKING),
    (TRACKING, STANDING_IN): ("main", TRACKING),
    (TRACKING, NOTHING): ("main", TRACKING),
    (WARMING_UP, SETTLED): ("active", DEGRADED),
    (WARMING_UP, COMPLETE): ("main", WARMING_UP),
    (WARMING_UP, STANDING_IN): ("main", WARMING_UP),
    (WARMING_UP, NOTHING): ("main", WARMING_UP),
    (DEGRADED, SETTLED): ("main", DEGRADED),
    (DEGRADED, COMPLETE): ("main", DEGRADED),
    (DEGRADED, STANDING_IN): ("main", DEGRADED),
    (DEGRADED, NOTHING): ("main", DEGRADED),
    (COASTING, SETTLED): ("first", DEGRADED),
    (COASTING, COMPLETE): ("first", DEGRADED),
    (COASTING, STANDING_IN): ("active", COASTING),
    (COASTING, NOTHING): ("main", COASTING),
    (FAULTED, SETTLED): ("first", DEGRADED),
    (FAULTED, COMPLETE): ("first", DEGRADED),
    (FAULTED, STANDING_IN): ("active", COASTING),
    (FAULTED, NOTHING): ("main", FAULTED),
}
"""By the main one's status and that of the fallbacks: the active estimator and the published status.

Active is the main one, the fallback that was active last, or the first fallback that has all its inputs.
"""


def has_all_inputs(status: str) -> bool:
    """Whether an estimator with this status has all its inputs."""
    return status in ALL_INPUTS


def decide(main: str, fallbacks: Sequence[str], active: int) -> tuple[int, str]:
    """The estimator to publish and the status, from each estimator's own status and the one ``active`` last."""
    complete = [number for number, status in enumerate(fallbacks, 1) if has_all_inputs(status)]
    which, status = TABLE[main, _availability(NOTHING if active == MAIN else fallbacks[active - 1], bool(complete))]
    if which == "main":
        return MAIN, status
    return (active if which == "active" else complete[0]), status


def _availability(active: str, complete: bool) -> str:
    """From the status of the fallback that was ``active`` last, and whether one has all its inputs."""
    if active == TRACKING:
        return SETTLED
    if complete:
        return COMPLETE
    return STANDING_IN if active == COASTING else NOTHING
