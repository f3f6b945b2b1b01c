"""A run is conducted here: threads tell what they see; this one writes it down, moves the program, sees to safety.

However a run ends, the safe set point goes to the chamber before a word is said, and until the chamber confirms it.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Callable
from enum import Enum
from typing import NamedTuple, Protocol

from ambient_trainer.laboratory.bench import (
    Bench,
    ambient_degC,
    device_sample,
    multiplexer_sample,
    thermometer_sample,
)
from ambient_trainer.laboratory.doer import Doer
from ambient_trainer.laboratory.journal import Began, End, Entry, Journal, Note
from ambient_trainer.laboratory.keeper import Keeper, Wish
from ambient_trainer.laboratory.messages import (
    CHAMBER,
    DEVICE,
    MULTIPLEXER,
    THERMOMETER,
    Crash,
    Doing,
    Message,
    Sample,
    Timebase,
    Trouble,
)
from ambient_trainer.laboratory.program import Program
from ambient_trainer.laboratory.safety import Watch
from ambient_trainer.laboratory.sampler import Sampler, Worker

_LOOK_S = 0.02
"""The machine's seconds between two looks at the program where nothing comes in."""
_PATIENCE_S = 15.0
"""For the device to rest, and for threads to end."""
_FRESH_PERIODS = 3.0
"""What the device said longer ago tells nothing about its rest."""


class Ending(Enum):
    """How a run ended."""

    FINISHED = "finished"
    STOPPED = "stopped"
    LIMIT = "limit"
    FAILED = "failed"


class Outcome(NamedTuple):
    """How and why a run ended."""

    ending: Ending
    why: str
    alarm: str | None
    """The chamber's, where it had one."""
    safe: bool
    """Whether the chamber confirmed its safe state."""


class Eyes(Protocol):
    """What watches a run for somebody."""

    def look(self, conductor: Conductor) -> None:
        """Called often; shows what there is."""

    def say(self, at_s: float, text: str) -> None:
        """Something happened."""


class Conductor:
    """One run of the program on ``bench``, from ``program``'s position on.

    ``stopping`` says whether somebody wants it to end; ``giving_up``, whether not even the chamber's confirmation is
    to be waited for.
    """

    def __init__(
        self,
        bench: Bench,
        timebase: Timebase,
        journal: Journal,
        program: Program,
        eyes: Eyes,
        stopping: Callable[[], str | None],
        giving_up: Callable[[], bool],
    ) -> None:
        self.bench = bench
        self.timebase = timebase
        self.journal = journal
        self.program = program
        self.latest: dict[str, Sample] = {}
        """The newest sample of each instrument."""
        self.ambient_degC: float | None = None
        self.troubles: dict[str, Trouble] = {}
        """What does not work now, by instrument, as it began."""
        self.alarm: str | None = None
        self._laboratory = bench.campaign.laboratory
        self._eyes = eyes
        self._stopping = stopping
        self._giving_up = giving_up
        self._messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._watch = Watch(self._laboratory.safety, timebase.now_s())
        self._told: dict[str, set[str]] = {}
        self._notes: dict[str, str | None] = {}
        self._crash: BaseException | None = None
        self.keeper = self._new_keeper(_wish_of(program))
        self.doer = Doer(self._laboratory, bench.way, timebase, self._messages.put)
        self._workers: list[Worker] = [self.keeper, self.doer, *self._samplers()]

    def conduct(self) -> Outcome:
        """Run the program to its end, or to safety."""
        outcome = Outcome(Ending.FAILED, "the program failed", None, False)
        try:
            for worker in self._workers:
                worker.start()
            self._order()
            now_s = self.timebase.now_s()
            self._write(Began(now_s, self.program.step, now_s - self.program.began_s))
            ending, why = self._until_over()
            outcome = Outcome(ending, why, None, False)
        except Exception as error:
            # whatever it is: the chamber comes first, and then it is told
            outcome = outcome._replace(why=f"{type(error).__name__}: {error}")
        finally:
            left_s = self.timebase.now_s()
            safe = self._make_safe()
            self._write(End(left_s, outcome.why))
            if outcome.ending is Ending.FINISHED:
                self._tell(self.timebase.now_s(), "the program is over")
            else:
                self._say(outcome.why)
            running = [worker for worker in self._workers if worker.is_alive()]
            for worker in running:
                worker.finish()
            for worker in running:
                worker.join(_PATIENCE_S)
        return outcome._replace(alarm=self.alarm, safe=safe)

    def _samplers(self) -> list[Worker]:
        bench, links, post = self.bench, self._laboratory.instruments, self._messages.put
        base, device = self.timebase, self._laboratory.device
        found: list[Worker] = [
            Sampler(
                MULTIPLEXER,
                base,
                post,
                links.multiplexer.period_s,
                lambda: multiplexer_sample(bench, base),
                bench.multiplexer.close,
            ),
            Sampler(DEVICE, base, post, device.period_s, lambda: device_sample(bench, base), bench.device.close),
        ]
        if bench.thermometer is not None and links.thermometer is not None:
            take, close = (lambda: thermometer_sample(bench, base)), bench.thermometer.close
            found.append(Sampler(THERMOMETER, base, post, links.thermometer.period_s, take, close))
        return found

    def _new_keeper(self, wish: Wish) -> Keeper:
        gradients = any(step.gradient_K_min is not None for step in self.program.steps)
        period_s = self._laboratory.instruments.chamber.period_s
        return Keeper(self.bench.chamber, self.timebase, self._messages.put, period_s, wish, gradients)

    def _until_over(self) -> tuple[Ending, str]:
        while not self.program.over:
            self._listen()
            if self._crash is not None:
                return Ending.FAILED, f"{type(self._crash).__name__}: {self._crash}"
            if self.journal.failure is not None:
                return Ending.FAILED, f"{self.journal.path}: cannot be written ({self.journal.failure.strerror})"
            if why := self._stopping():
                return Ending.STOPPED, why
            now_s = self.timebase.now_s()
            # after an alarm the chamber is stopped: there is nothing more to do, but to go on logging
            if self.alarm is None and (why := self._watch.verdict(now_s)):
                return Ending.LIMIT, why
            for reached in self.program.advance(now_s):
                if reached.unsettled:
                    self._say(f"step {reached.step} went on unsettled: it was given no more time")
                self._write(Began(reached.at_s, reached.step, 0.0))
                self._order()
            self._show()
        return Ending.FINISHED, "finished"

    def _order(self) -> None:
        """Have chamber and device do what the step asks for; with an alarm, both rest."""
        if self.alarm is not None or self.program.over:
            return
        wish = _wish_of(self.program)
        if wish != self.keeper.wish:
            self.keeper.want(wish)
        self.doer.want(self.program.now.load)

    def _listen(self) -> None:
        """Take in what the threads have said since the last call."""
        try:
            message = self._messages.get(timeout=_LOOK_S)
            while True:
                self._hear(message)
                message = self._messages.get_nowait()
        except queue.Empty:
            return

    def _hear(self, message: Message) -> None:
        if isinstance(message, Crash):
            self._crash = self._crash or message.error
        elif isinstance(message, Trouble):
            self.troubles.setdefault(message.source, message)
            told = self._told.setdefault(message.source, set())
            if message.text not in told:  # the same, every second of a night, would be the log
                told.add(message.text)
                self._write(message)
                self._tell(message.at_s, message.text)
        elif isinstance(message, Doing):
            self._write(message)
            if message.actions is not None:
                self._well(self.doer.source, message.at_s)
        else:
            self._take(message)

    def _take(self, sample: Sample) -> None:
        self._write(sample)
        self.latest[sample.source] = sample
        self._well(sample.source, sample.at_s)
        if sample.source == MULTIPLEXER:
            self.ambient_degC = ambient_degC(sample.values, self._laboratory.ambient)
            self._watch.hear_ambient(sample.answered_s, self.ambient_degC)
            self.program.hear(sample.answered_s, self.ambient_degC, self._zones(sample.answered_s))
        else:
            self._watch.hear(sample.values)
        if sample.note != self._notes.get(sample.source):
            self._notes[sample.source] = sample.note
            self._noted(sample)

    def _noted(self, sample: Sample) -> None:
        if sample.source == CHAMBER and sample.note is not None:
            self.alarm = self.alarm or sample.note
            self.keeper.want(Wish(None, urgent=True))
            self.doer.want(())
            self._say(f"the chamber raised an alarm ({sample.note}): it was stopped, and the logging goes on")
        elif sample.note is not None:
            self._say(f"{sample.source}: {sample.note}")

    def _well(self, source: str, at_s: float) -> None:
        trouble = self.troubles.pop(source, None)
        if trouble is not None:
            del self._told[source]
            self._say(f"{source} is back after {at_s - trouble.at_s:.0f} s")

    def _zones(self, now_s: float) -> dict[str, float]:
        """What the device's zones say, if it is new enough."""
        sample, device = self.latest.get(DEVICE), self._laboratory.device
        if sample is None or now_s - sample.answered_s > _FRESH_PERIODS * device.period_s + device.timeout_s:
            return {}
        return {name: value for name in device.zones.values() if (value := sample.values.get(name)) is not None}

    def _make_safe(self) -> bool:
        """Send the chamber to safety and the device to rest, and wait; whether the chamber confirmed it."""
        safe = Wish(None if self.alarm is not None else self._laboratory.safety.set_point_degC, urgent=True)
        if not self.keeper.is_alive():
            self.keeper = self._new_keeper(safe)
            self._workers.append(self.keeper)
            self.keeper.start()
        self.keeper.want(safe)
        self.doer.want(())
        began_s = told_s = time.monotonic()
        while not self._giving_up():
            with contextlib.suppress(Exception):  # that the chamber is safe matters more than what is said meanwhile
                self._listen()
            self._show()
            waited_s = time.monotonic() - began_s
            if self.keeper.confirmed and (self.doer.confirmed or waited_s > _PATIENCE_S):
                return True
            if time.monotonic() - told_s > _PATIENCE_S and not self.keeper.confirmed:
                told_s = time.monotonic()
                self._say("the chamber has not confirmed its safe set point yet: it is told again and again")
        return self.keeper.confirmed

    def _say(self, text: str) -> None:
        now_s = self.timebase.now_s()
        self._write(Note(now_s, text))
        self._tell(now_s, text)

    def _tell(self, at_s: float, text: str) -> None:
        # a terminal that was closed is no reason to leave the chamber alone
        with contextlib.suppress(Exception):
            self._eyes.say(at_s, text)

    def _show(self) -> None:
        with contextlib.suppress(Exception):
            self._eyes.look(self)

    def _write(self, entry: Entry) -> None:
        self.journal.add(entry)


def _wish_of(program: Program) -> Wish:
    return Wish(program.now.chamber_degC, program.now.gradient_K_min)
