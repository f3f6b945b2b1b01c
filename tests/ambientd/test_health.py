"""The status table, case by case, and what holds whatever happens."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from ambientd.fallback import FallbackTracker
from ambientd.health import MAIN, TABLE, decide

OWN = ("warming_up", "tracking", "degraded", "coasting", "faulted")
FRESH = ("warming_up", "tracking")
COMPLETE = (*FRESH, "degraded")
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


def test_the_table_is_complete_and_without_a_fallback_nothing_changes():
    offers = {offer for _, offer in TABLE}
    assert set(TABLE) == set(itertools.product(OWN, offers))
    assert [decide(status, [], MAIN) for status in OWN] == [(MAIN, status) for status in OWN]


readings = st.none() | st.sampled_from([-20.1, -20.0, 25.0, 69.9, 70.0, 70.1, 90.0, 90.1, 1e30])
seconds = st.sampled_from([0.0, 0.3, 1.0, 1.0, 1.0, 5.0, 29.0, 31.0, 3600.0, -1.0, -86400.0])


@given(st.lists(st.tuples(seconds, readings, readings), max_size=40), st.booleans())
def test_whatever_happens_only_trusted_inputs_are_tracked(make_model, drawn, fallbacks):
    model = make_model(fallbacks=fallbacks)
    tracker = FallbackTracker(model, 1.0)
    now_s = 1e6
    lost = False
    for passed_s, *raw in drawn:
        now_s += passed_s
        estimate = tracker.update(now_s, raw)
        trusted = [value is not None and each.min <= value <= each.max for each, value in zip(model.main.inputs, raw)]
        assert (estimate.status in FRESH) <= all(trusted)
        lost = lost or not all(trusted)
        # after a loss, a fallback that has settled is not interrupted
        assert all(trusted) <= (estimate.status in (COMPLETE if lost and fallbacks else FRESH))
        if fallbacks:
            assert (estimate.status == "degraded") <= any(trusted)
        assert (estimate.ambient_degC is None) == (estimate.status == "faulted")
