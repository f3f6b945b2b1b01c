"""One run of a program: threads post what they read; the run writes it down, moves the program, and sees to safety.

However a run ends, the safe set point goes to the chamber before anything is shown, and until the chamber confirms it
or a minute is over; from then on the watchdog sends it.
"""

from __future__ import annotations

import contextlib
import math
import queue
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

from ambient_model.faults import Fault, Refused
from ambient_trainer.laboratory import messages
from ambient_trainer.laboratory.campaign import Campaign, LoadedCampaign
from ambient_trainer.laboratory.device_under_test import DeviceUnderTest
from ambient_trainer.laboratory.instruments import instrument
from ambient_trainer.laboratory.journal import Journal
from ambient_trainer.laboratory.messages import CHAMBER, DEVICE, MULTIPLEXER, Clock, InstrumentError, Reading, Sample
from ambient_trainer.laboratory.program import Program, SafetyLimits
from ambient_trainer.laboratory.shell import connection_to
from ambient_trainer.laboratory.watchdog import Watchdog
from ambient_trainer.laboratory.workers import ChamberControl, LoadControl, Sampler, Target, Worker

Equipment = Mapping[str, tuple[Any, float]]
"""Drivers of the instruments and the device by source, the chamber first, with their periods."""


def equipment_of(loaded: LoadedCampaign, clock: Clock, environment: Mapping[str, str] | None = None) -> Equipment:
    """The equipment that a campaign names; ``environment`` is added to that of the device's shells."""
    laboratory = loaded.campaign.laboratory
    further = {CHAMBER: (laboratory.safety.chamber,), MULTIPLEXER: (loaded.offsets,)}
    drivers: dict[str, tuple[Any, float]] = {
        role: (instrument(named.kind).Driver(named, clock, *further.get(role, ())), named.period_s)
        for role, named in laboratory.instruments.named.items()
    }
    connection = connection_to(laboratory.device.connect, environment)
    drivers[DEVICE] = DeviceUnderTest(laboratory.device, connection, clock), laboratory.device.period_s
    return drivers


def identify(equipment: Equipment, loaded: LoadedCampaign) -> list[messages.Identity | messages.Note]:
    """Each instrument's own identification, and then a warning of each that cannot hold its period.

    Raises :class:`Refused` with each that does not answer, is in alarm, or lacks a value that the campaign needs.
    """
    laboratory, faults = loaded.campaign.laboratory, list[Fault]()
    found, slow = list[messages.Identity](), list[messages.Note]()
    for source, (driver, period_s) in equipment.items():
        port = getattr(laboratory.instruments.named.get(source), "port", "")
        try:
            found.append(messages.Identity(source, driver.identify()))
            reading = driver.read()
            if source == CHAMBER and reading.note:
                hint = "see to it, and acknowledge it at the chamber"
                raise InstrumentError(source, port, "no alarm", reading.note, hint)
            probes = laboratory.ambient.readings(reading.values) if source == laboratory.reference else {}
            if silent := [name for name, value in probes.items() if value is None]:
                expected, got = "a reading of every probe of the ambient", f"no reading of {', '.join(silent)}"
                hint = "connect it, or take it out of 'laboratory.ambient.probes'"
                raise InstrumentError(source, port, expected, got, hint)
            if source != CHAMBER and (text := _slowness(source, reading, period_s)):
                slow.append(messages.Note(0.0, text))
        except InstrumentError as error:
            faults.append(Fault(f"{source} on {error.port}", f"expected {error.expected}, got {error.got}", error.hint))
    if faults:
        raise Refused("the laboratory is not ready, and nothing was moved", faults)
    return [*found, *slow]


def _slowness(source: str, reading: Reading | Sample, period_s: float) -> str | None:
    """What to say of an instrument whose answer takes longer than its period; None where it does not."""
    took_s = reading.answered_s - reading.asked_s
    if took_s <= period_s:
        return None
    wanted = f"its 'period_s' is {period_s:g}: give it {math.ceil(took_s)} or more"
    return f"{source} takes {took_s:.1f} s for an answer, so that cells stay empty; {wanted}"


_POLL_S = 0.02  # the machine's seconds between two looks at the program where nothing comes in
_PATIENCE_S = 15.0  # for the device to stop its actions, for gradients to be lifted, and for threads to end
_SAFE_S = 60.0  # the machine's seconds for the chamber to confirm its safe set point
_LONGEST_WAIT_S = 1800.0  # for a set point that the campaign waits for; then the run ends
_ASLEEP_S = 10.0  # the machine's seconds in which nothing ran: the program was stopped, or the machine suspended
_FRESH_PERIODS = 3.0  # an older sample of the device is no evidence of its steady state
_SLOW_TIMES = 5  # an instrument whose answers take longer than its period so many times in a row cannot hold it


class Ending(Enum):
    """How a run ended."""

    FINISHED = "finished"
    DEVIATED = "deviated"
    """The program came to its end, but the chamber did not do all of it."""
    STOPPED = "stopped"
    LIMIT = "limit"
    FAILED = "failed"


class Outcome(NamedTuple):
    """How and why a run ended, the chamber's alarm, and whether the chamber confirmed its safe state."""

    ending: Ending
    why: str
    alarm: str | None
    safe: bool

    @property
    def finished(self) -> bool:
        """Whether the chamber did all of the program."""
        return self.ending is Ending.FINISHED


class Supervision(NamedTuple):
    """Who watches a run: ``update`` is called often, ``event`` with a time and a text for each event.

    ``stopping`` gives the reason to stop (or None), ``giving_up`` whether not even to wait for the chamber.
    """

    update: Callable[[CampaignRun], None]
    event: Callable[[float, str], None]
    stopping: Callable[[], str | None]
    giving_up: Callable[[], bool]

    def show(self, at_s: float, text: str) -> None:
        """Hand an event on; that a terminal was closed is no reason to leave the chamber alone."""
        with contextlib.suppress(Exception):
            self.event(at_s, text)


@dataclass(eq=False)
class CampaignRun:
    """One run of the program on ``equipment``, from the program's position on.

    ``latest`` holds the newest sample of each instrument, ``failures`` what does not work now, as it began.
    """

    campaign: Campaign
    _equipment: Equipment
    clock: Clock
    journal: Journal
    program: Program
    _supervision: Supervision

    def __post_init__(self) -> None:
        self.latest: dict[str, Sample] = {}
        self.failures: dict[str, messages.Failure] = {}
        self.ambient_degC: float | None = None
        self.alarm: str | None = None
        self._laboratory = self.campaign.laboratory
        self._messages: queue.SimpleQueue[messages.Message] = queue.SimpleQueue()
        self._limits = SafetyLimits(self._laboratory.safety, self.clock.now_s())
        self._failure_texts: dict[str, set[str]] = {}
        self._slow: Counter[str] = Counter()
        self._held_s: float | None = None
        self.load = LoadControl(self._laboratory, self._equipment[DEVICE][0].connection, self.clock, self._messages.put)
        self._workers: list[Worker] = [self.load]
        self.chamber = self._new_chamber_control(self._target())
        for source, (driver, period_s) in self._equipment.items():
            if source != CHAMBER:
                self._workers.append(Sampler(source, driver, period_s, self.clock, self._messages.put))

    def conduct(self, watchdog: Watchdog | None = None) -> Outcome:
        """Run the program to its end, or to safety; ``watchdog`` is started again where it dies meanwhile."""
        ending, why = Ending.FAILED, "the program failed"
        try:
            for worker in self._workers:
                worker.start()
            self._apply_step()
            self._begin_step()
            ending, why = self._until_over(watchdog)
        except Exception as error:  # whatever it is: the chamber comes first, and then it is shown
            why = f"{type(error).__name__}: {error}"
        finally:
            self._go_on()
            self.journal.add(messages.End(self.clock.now_s(), why))
            safe = self._make_safe()
            if ending is Ending.FINISHED:
                self._supervision.show(self.clock.now_s(), "the program is over")
            else:
                self._note(why)
            for worker in self._workers:
                worker.finish()
            for worker in self._workers:
                with contextlib.suppress(RuntimeError):  # it was never started
                    worker.join(_PATIENCE_S)
        return Outcome(ending, why, self.alarm, safe)

    def _new_chamber_control(self, target: Target) -> ChamberControl | None:
        if CHAMBER not in self._equipment:
            return None
        driver, period_s = self._equipment[CHAMBER]
        confirm_s = self._laboratory.safety.confirm_s
        control = ChamberControl(driver, self.clock, self._messages.put, period_s, target, confirm_s)
        self._workers.append(control)
        return control

    def _until_over(self, watchdog: Watchdog | None) -> tuple[Ending, str]:
        now_s = self.clock.now_s()
        while not self.program.over:
            self._receive()
            if crash := next((each.crash for each in self._workers if each.crash), None):
                return Ending.FAILED, f"{type(crash).__name__}: {crash}"
            if self.journal.failure is not None:
                return Ending.FAILED, f"{self.journal.path}: cannot be written ({self.journal.failure.strerror})"
            if watchdog is not None and (text := watchdog.check()):
                self._note(text)
            if why := self._supervision.stopping():
                return Ending.STOPPED, why
            before_s, now_s = now_s, self.clock.now_s()
            if self._held_s is None and self.clock.wall_s(now_s - before_s) > _ASLEEP_S:
                self._held_s = before_s
                self._go_on()
                self._note(f"nothing ran here for {now_s - before_s:.0f} s, which do not count as time in the step")
            # after an alarm the chamber is stopped: there is nothing more to do, but to go on logging
            if (why := self._unconfirmed(now_s) or self._limits.violation(now_s)) and self.alarm is None:
                return Ending.LIMIT, why
            for began, unsettled in self.program.advance(now_s) if self._held_s is None else ():
                if unsettled:
                    self._note(f"step {began.step} went on unsettled: it was given no more time")
                self.journal.add(began)
                self._apply_step()
            self._update_monitor()
        return Ending.FINISHED, "finished"

    def _begin_step(self) -> None:
        now_s = self.clock.now_s()
        self.journal.add(messages.StepBegan(now_s, self.program.step, now_s - self.program.began_s))

    def _go_on(self) -> None:
        """Be in the step where it was held, if it is: that time does not count."""
        if self._held_s is not None:
            self.program.began_s += self.clock.now_s() - self._held_s
            self._held_s = None
            self._begin_step()

    def _unconfirmed(self, now_s: float) -> str | None:
        """Why the run ends because of a set point that is not confirmed; holds the program where that is asked for."""
        failure, wanted = self.failures.get(messages.CHAMBER_SET_POINT), self._laboratory.safety.unconfirmed
        failure = failure if self.alarm is None else None
        if failure is not None and wanted == "wait" and self._held_s is None:
            self._held_s = failure.at_s
        elif failure is None:
            self._go_on()
        waited_s = 0.0 if self._held_s is None else now_s - self._held_s
        return failure.text if failure and (wanted == "end" or waited_s > _LONGEST_WAIT_S) else None

    def _apply_step(self) -> None:
        """Send chamber and device to what the step asks for; after an alarm, both stay stopped."""
        if self.alarm is not None or self.program.over:
            return
        if self.chamber is not None and (target := self._target()) != self.chamber.target:
            for source in (messages.CHAMBER_SET_POINT, messages.CHAMBER_GRADIENT):  # of the target before
                self.failures.pop(source, None)
            self.chamber.go_to(target)
        self.load.go_to(self.program.now.load)

    def _receive(self) -> None:
        """Take in what the threads have posted since the last call."""
        with contextlib.suppress(queue.Empty):
            self._take(self._messages.get(timeout=_POLL_S))
            while True:
                self._take(self._messages.get_nowait())

    def _take(self, message: messages.Message) -> None:
        if isinstance(message, messages.Failure):
            self.failures.setdefault(message.source, message)
            texts = self._failure_texts.setdefault(message.source, set())
            if message.text not in texts:  # the same, every second of a night, would be the log
                texts.add(message.text)
                self.journal.add(message)
                self._supervision.show(message.at_s, message.text)
        elif isinstance(message, messages.Recovered):
            self._recovered(*message)
        elif isinstance(message, messages.LoadState):
            self.journal.add(message)
            if message.actions is not None:
                self._recovered(self.load.source, message.at_s)
        else:
            self._take_sample(message)

    def _take_sample(self, sample: Sample) -> None:
        self.journal.add(sample)
        before = self.latest.get(sample.source)
        self.latest[sample.source] = sample
        self._recovered(sample.source, sample.at_s)
        if sample.source == self._laboratory.reference:
            self.ambient_degC = self._laboratory.ambient.mean_degC(sample.values)
            self._limits.check_ambient(sample.answered_s, self.ambient_degC)
            self.program.update(sample.answered_s, self.ambient_degC, self._zones(sample.answered_s))
        else:
            self._limits.check(sample.values)
        self._check_pace(sample)
        if sample.note != (before.note if before else None):
            if self.chamber is not None and sample.source == CHAMBER and sample.note is not None:
                self.alarm = self.alarm or sample.note
                self.chamber.go_to(Target(None, urgent=True))
                self.load.go_to(())
                text = f"the chamber raised an alarm ({sample.note}): it was stopped, and the logging goes on"
                self._take(messages.Failure(messages.CHAMBER_SET_POINT, sample.at_s, text))
            elif sample.note is not None:
                self._note(f"{sample.source}: {sample.note}")

    def _check_pace(self, sample: Sample) -> None:
        slow = _slowness(sample.source, sample, self._equipment[sample.source][1])
        if sample.source != CHAMBER and self._slow[sample.source] < _SLOW_TIMES:
            self._slow[sample.source] = self._slow[sample.source] + 1 if slow else 0
            if slow and self._slow[sample.source] == _SLOW_TIMES:
                self._note(slow)

    def _recovered(self, source: str, at_s: float) -> None:
        failure = self.failures.pop(source, None)
        if failure is not None:
            del self._failure_texts[source]
            self._note(f"{source} is back after {at_s - failure.at_s:.0f} s")

    def _zones(self, now_s: float) -> dict[str, float]:
        """The device's zones, if its newest sample is fresh enough."""
        sample, device = self.latest.get(DEVICE), self._laboratory.device
        if sample is None or now_s - sample.answered_s > _FRESH_PERIODS * device.period_s + device.timeout_s:
            return {}
        return {name: value for name in device.zones.values() if (value := sample.values.get(name)) is not None}

    def _make_safe(self) -> bool:
        """Send the chamber to safety, stop the actions, and wait, at most until a signal; whether it confirmed."""
        safe_degC = None if self.alarm is not None else self._laboratory.safety.set_point_degC
        safe = Target(safe_degC, self.campaign.no_gradient_K_min, urgent=True)
        if self.chamber is not None and not self.chamber.is_alive():
            self.chamber = self._new_chamber_control(safe)
            assert self.chamber is not None
            self.chamber.start()
        if self.chamber is not None:
            self.chamber.go_to(safe)
        self.load.go_to(())
        began_s, stopped, safe_now = time.monotonic(), self._supervision.stopping(), False
        while (waited_s := time.monotonic() - began_s) < _SAFE_S:
            if self._supervision.giving_up() or (self._supervision.stopping() and not stopped):
                break
            with contextlib.suppress(Exception):  # that the chamber is safe matters more than what is posted meanwhile
                self._receive()
            self._update_monitor()
            safe_now = self.chamber is None or self.chamber.confirmed
            settled = (self.chamber is None or self.chamber.settled) and self.load.confirmed
            if safe_now and (settled or waited_s > _PATIENCE_S):
                break
        return safe_now

    def _note(self, text: str) -> None:
        now_s = self.clock.now_s()
        self.journal.add(messages.Note(now_s, text))
        self._supervision.show(now_s, text)

    def _update_monitor(self) -> None:
        with contextlib.suppress(Exception):
            self._supervision.update(self)

    def _target(self) -> Target:
        step = self.program.now
        return Target(step.chamber_degC, step.gradient_K_min or self.campaign.no_gradient_K_min)
