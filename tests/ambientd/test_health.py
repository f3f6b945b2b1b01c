"""The status table, case by case; what holds whatever happens is among the hostile files' tests."""

import itertools

from ambientd.health import MAIN, decide

OWN = ("warming_up", "tracking", "degraded", "coasting", "faulted")
COMPLETE = ("warming_up", "tracking", "degraded")
"""The last by itself: the estimate is blended with the secondary one."""


def test_every_case_is_decided_as_it_was_promised():
    """In words of the test's own: the complete first, the main one before all; then the last active; then the main.

    But a main one that has not settled does not interrupt a fallback that has.
    """
    for *statuses, active in itertools.product(OWN, OWN, OWN, range(3)):
        complete = [number for number, status in enumerate(statuses) if status in COMPLETE]
        if statuses[0] == "warming_up" and active != MAIN and statuses[active] == "tracking":
            wanted = (active, "degraded")
        elif complete:
            wanted = (complete[0], statuses[0] if complete[0] == MAIN else "degraded")
        else:
            which = active if statuses[active] == "coasting" else MAIN
            wanted = (which, statuses[which])
        assert decide(statuses[0], statuses[1:], active) == wanted, (statuses, active)
