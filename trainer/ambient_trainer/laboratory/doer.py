"""The device is made to do what a step asks for, and again after it was lost: what it does is known, or said not to be.

Actions go over a shell of their own: one that takes seconds delays no sample.
"""

from __future__ import annotations

from ambient_trainer.laboratory.campaign import Laboratory
from ambient_trainer.laboratory.line import LineError
from ambient_trainer.laboratory.messages import DEVICE, Doing, Post, Timebase, Trouble
from ambient_trainer.laboratory.sampler import Worker
from ambient_trainer.laboratory.shell import Shell, Way

SOURCE = f"{DEVICE}'s actions"
_LOOK_S = 2.0
_RETRY_S = 5.0
_LONGEST_S = 60.0
"""A camera takes its time."""


class ActionFailed(LineError):
    """A command of an action said that it did not work."""

    mend = "try the command in a shell on the device; it is tried again"


class Doer(Worker):
    """Keeps the device at the actions that were last asked for."""

    def __init__(self, laboratory: Laboratory, way: Way, timebase: Timebase, post: Post) -> None:
        super().__init__(SOURCE, timebase, post)
        self._actions = laboratory.actions
        self._shell = Shell(way, timebase.clock, _LONGEST_S, laboratory.device.setup)
        self._wanted: tuple[str, ...] = ()
        self._opened = 0
        self._done: tuple[str, ...] | None = None
        """None: not known."""
        self._told: tuple[str, ...] | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the device does what is wanted now."""
        return self._done == self._wanted

    def want(self, actions: tuple[str, ...]) -> None:
        """Want these from now on; returns at once."""
        self._wanted = actions
        self.woken.set()

    def turn(self) -> float:
        """Stop what is not wanted, start what is."""
        wanted = self._wanted
        try:
            if self._done is not None and not self._shell.alive:
                self._now(None)
                self._shell.close()
            if self._done is None:
                self._rest()
            if self._done != wanted:
                self._change(self._done or (), wanted)
        except LineError as error:
            self._now(None)
            self.post(Trouble(self.source, self.timebase.now_s(), str(error)))
            return self.timebase.now_s() + _RETRY_S
        return self.timebase.now_s() + _LOOK_S

    def leave(self) -> None:
        """Close the shell."""
        self._shell.close()

    def _now(self, done: tuple[str, ...] | None) -> None:
        self._done = done
        if done != self._told:
            self._told = done
            self.post(Doing(self.timebase.now_s(), done))

    def _rest(self) -> None:
        """A known state: nothing is done."""
        for name, action in self._actions.items():
            self._run(name, "stop", action.stop)
        self._now(())

    def _change(self, now: tuple[str, ...], wanted: tuple[str, ...]) -> None:
        for name in reversed(now):
            if name not in wanted:
                self._run(name, "stop", self._actions[name].stop)
        for name in wanted:
            if name not in now:
                self._run(name, "start", self._actions[name].start)
        self._now(wanted)

    def _run(self, name: str, what: str, command: str) -> None:
        status = self._shell.ask(command).status
        if status:
            raise ActionFailed(DEVICE, self._shell.way.label, f"action {name} to {what}", f"exit status {status}")
