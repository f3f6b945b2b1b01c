"""An absolute schedule, on a clock that moves only when it is waited on."""

import math

from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.line import Silent
from ambient_trainer.laboratory.messages import Crash, Sample, Timebase, Trouble
from ambient_trainer.laboratory.sampler import Sampler


class StillClock:
    """Time that passes by waiting and by asking, and else not at all."""

    def __init__(self):
        self.time_s = 1000.0

    def now_s(self):
        return self.time_s

    def wait(self, event, duration_s):
        self.time_s += max(duration_s, 1e-9)  # never nothing, as of a machine
        return event.is_set()


def sampled(durations_s, period_s, zero_s=1000.0, errors=()):
    """What a sampler posts that takes so long for each of its samples; then it ends."""
    clock, posted, closed = StillClock(), [], []
    base = Timebase(clock, zero_s)
    left = list(durations_s)

    def take():
        asked_s = base.now_s()
        clock.time_s += left.pop(0)
        if not left:
            sampler.finish()
        if len(left) in errors:
            raise errors[len(left)]
        return Sample("x", asked_s, base.now_s(), {})

    sampler = Sampler("x", base, posted.append, period_s, take, lambda: closed.append(True))
    sampler.run()
    assert closed == [True]
    return posted


def test_each_period_is_asked_for_when_it_begins():
    asked = [sample.asked_s for sample in sampled([0.3, 0.1, 0.9, 0.2], 1.0, zero_s=999.5)]
    assert asked == [1.0, 2.0, 3.0, 4.0]


def test_what_is_late_leaves_out_and_does_not_catch_up():
    asked = [sample.asked_s for sample in sampled([0.1, 3.4, 0.1, 0.1], 1.0)]
    assert asked == [1.0, 2.0, 6.0, 7.0]


@given(st.lists(st.floats(0.0, 5.0), min_size=1, max_size=20), st.floats(0.05, 3.0))
def test_every_sample_is_asked_for_at_a_multiple_of_its_own(durations_s, period_s):
    asked = [sample.asked_s for sample in sampled(durations_s, period_s)]
    places = [each / period_s for each in asked]
    assert all(math.isclose(place, round(place), rel_tol=1e-9, abs_tol=1e-6) for place in places)
    assert len({round(place) for place in places}) == len(places)


def test_trouble_is_told_and_the_next_one_is_asked_for():
    error = Silent("multiplexer", "/dev/x", "4 readings", "nothing in 5 s")
    first, trouble, last = sampled([0.1, 0.1, 0.1], 1.0, errors={1: error})
    assert isinstance(first, Sample)
    assert trouble._replace(at_s=round(trouble.at_s, 6)) == Trouble("x", 2.1, str(error))
    assert last.asked_s == 3.0


def test_a_mistake_of_the_program_ends_the_thread_and_is_told():
    error = KeyError("mistake")
    first, crash = sampled([0.1, 0.1, 0.1], 1.0, errors={1: error})
    assert isinstance(first, Sample)
    assert crash == Crash("x", error)
