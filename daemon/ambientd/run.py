"""``ambientd run``: the parts put together, and taken apart again whatever happens."""

import contextlib
from collections.abc import Callable, Iterator

from ambient_model.codec import load_model
from ambient_model.faults import refuse
from ambient_model.model import Model
from ambientd.config import Settings
from ambientd.fallback import FallbackTracker
from ambientd.notices import say
from ambientd.publish import Publisher, open_publisher
from ambientd.publish.spec import Spec
from ambientd.schedule import Waiter, clock_s, ticks
from ambientd.service import Service
from ambientd.sources.replay import Sample, TraceSource, tracker_for


def run_zones(settings: Settings) -> None:
    """Poll the thermal zones at ``rate_hz`` and publish, until a signal ends it. Raises :class:`Refused`."""
    from ambientd.sources.assign import assigned_sensors
    from ambientd.sources.zones import Zones

    model = load_model(settings.model)
    period_s = 1 / settings.rate_hz
    tracker = FallbackTracker(model, period_s, settings.level_percent)
    sensors = assigned_sensors(settings, model)
    with Waiter() as waiter, contextlib.closing(Zones(settings.sysfs_root, sensors, say)) as zones:
        samples = ((now_s, zones.read(now_s)) for now_s in ticks(period_s, waiter.until))
        _serve(settings, model, tracker, samples, waiter, 0, f"thermal zones under {settings.sysfs_root}")


def run_replayed(settings: Settings, trace: str, rate_hz: float | None, speed: float) -> None:
    """Publish the estimates for ``trace`` and end with it, or when a signal comes. Raises :class:`Refused`.

    A row comes 1 / ``rate_hz`` s after the last, or, where that is None, as the trace's times say, ``speed`` times as
    fast; 0 is as fast as it goes.
    """
    model = load_model(settings.model)
    with Waiter() as waiter, TraceSource(trace, model.main.inputs) as source:
        tracker = tracker_for(model, source, settings.level_percent)
        samples = _paced(iter(source), _delay_after_start(rate_hz, speed), waiter.until)
        in_a_hurry = rate_hz is None and speed == 0
        unheard = _serve(settings, model, tracker, samples, waiter, None if in_a_hurry else 0, trace)
        if unheard:
            raise refuse(", ".join(unheard), "", "could not be written at any row", "see the message above")


def _delay_after_start(rate_hz: float | None, speed: float) -> Callable[[int, float], float]:
    """From a row's number and its time after the first row's, how long after the start it is due, all in s."""
    if rate_hz is not None:
        return lambda row, passed_s: row / rate_hz
    if speed == 0:
        return lambda row, passed_s: 0.0
    return lambda row, passed_s: passed_s / speed


def _paced(
    rows: Iterator[Sample], delay_s: Callable[[int, float], float], until: Callable[[float], bool]
) -> Iterator[Sample]:
    start_s = clock_s()
    first_s: float | None = None
    for index, sample in enumerate(rows):
        first_s = sample[0] if first_s is None else first_s
        if not until(start_s + delay_s(index, sample[0] - first_s)):
            return
        yield sample


def _serve(
    settings: Settings,
    model: Model,
    tracker: FallbackTracker,
    samples: Iterator[Sample],
    waiter: Waiter,
    patience_ms: int | None,
    origin: str,
) -> list[str]:
    """Serve until the samples end or a signal comes; the names of the publishers that never published."""
    with contextlib.ExitStack() as stack:
        publishers = [_opened(stack, spec, patience_ms, waiter) for spec in settings.publish]
        say(f"model '{model.name}' at {tracker.period_s:g} s on {origin}, to {', '.join(map(str, settings.publish))}")
        service = Service(model, settings.level_percent, tracker, samples, publishers, say)
        while service.tick():
            pass
        return service.unheard


def _opened(stack: contextlib.ExitStack, spec: Spec, patience_ms: int | None, waiter: Waiter) -> tuple[str, Publisher]:
    publisher = open_publisher(spec, patience_ms)
    stack.callback(_closed, publisher, str(spec))
    descriptor = publisher.descriptor()
    if descriptor is not None:
        waiter.serve(descriptor, publisher.serve)
    return str(spec), publisher


def _closed(publisher: Publisher, name: str) -> None:
    try:
        publisher.close()
    except OSError as error:
        say(f"{name}: cannot be removed ({error.strerror or error})")
