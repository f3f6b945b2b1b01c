"""An absolute schedule, on a clock that moves only when it is waited on."""

import math

from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.messages import Crash, Failure, NoResponse, Reading, Sample
from ambient_trainer.laboratory.workers import Sampler


class StillClock:
    """Time that passes by waiting and by asking, and else not at all."""

    def __init__(self, time_s):
        self.time_s = time_s

    def now_s(self):
        return self.time_s

    def wait(self, event, duration_s):
        self.time_s += max(duration_s, 1e-9)  # never nothing, as of a machine
        return event.is_set()


class Slow:
    """An instrument that takes so long for each of its readings, and then has done its last one."""

    def __init__(self, clock, durations_s, errors):
        self.clock, self.left, self.errors = clock, list(durations_s), errors
        self.closed = False

    def read(self):
        asked_s = self.clock.now_s()
        self.clock.time_s += self.left.pop(0)
        if not self.left:
            self.sampler.finish()
        if len(self.left) in self.errors:
            raise self.errors[len(self.left)]
        return Reading(asked_s, self.clock.now_s(), {})

    def close(self):
        self.closed = True


def sampled(durations_s, period_s, begin_s=0.0, errors=()):
    """What a sampler of a slow instrument posts."""
    clock, posted = StillClock(begin_s), []
    instrument = Slow(clock, durations_s, errors)
    instrument.sampler = Sampler("x", instrument, period_s, clock, posted.append)
    instrument.sampler.run()
    assert instrument.closed
    return posted


def test_each_period_is_asked_for_when_it_begins():
    asked = [sample.asked_s for sample in sampled([0.3, 0.1, 0.9, 0.2], 1.0, begin_s=0.5)]
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
    error = NoResponse("multiplexer", "/dev/x", "4 readings", "nothing in 5 s")
    first, trouble, last = sampled([0.1, 0.1, 0.1], 1.0, errors={1: error})
    assert isinstance(first, Sample)
    assert trouble._replace(at_s=round(trouble.at_s, 6)) == Failure("x", 2.1, str(error))
    assert last.asked_s == 3.0


def test_a_mistake_of_the_program_ends_the_thread_and_is_told():
    error = KeyError("mistake")
    first, crash = sampled([0.1, 0.1, 0.1], 1.0, errors={1: error})
    assert isinstance(first, Sample)
    assert crash == Crash("x", error)
