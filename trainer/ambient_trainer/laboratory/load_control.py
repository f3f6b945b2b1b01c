"""The device is kept at the actions that a step asks for, also after it was lost: its load is known, or None.

Actions go over a shell of their own: one that takes seconds delays no sample.
"""

from __future__ import annotations

from ambient_trainer.laboratory.campaign import Laboratory
from ambient_trainer.laboratory.device.shell import Connection, Shell
from ambient_trainer.laboratory.messages import DEVICE, LoadState, Post, Timebase
from ambient_trainer.laboratory.reading import InstrumentError
from ambient_trainer.laboratory.worker import Worker

_PERIOD_S = 2.0
_RETRY_S = 5.0
_TIMEOUT_S = 60.0
"""A camera takes its time."""
_FAILED = "try the command in a shell on the device; it is tried again"


class LoadControl(Worker):
    """Keeps the device at the actions that were last asked for."""

    def __init__(self, laboratory: Laboratory, connection: Connection, timebase: Timebase, post: Post) -> None:
        super().__init__(f"{DEVICE}'s actions", timebase, post)
        self.shell = Shell(connection, timebase.clock, _TIMEOUT_S, laboratory.device.setup)
        self._actions = laboratory.actions
        self._target: tuple[str, ...] = ()
        self._active: tuple[str, ...] | None = None
        self._posted: tuple[str, ...] | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the newest target is what is active."""
        return self._active == self._target

    def go_to(self, actions: tuple[str, ...]) -> None:
        """Keep these active from now on; returns at once."""
        self._target = actions
        self.woken.set()

    def turn(self) -> float:
        """Stop what is not in the target, start what is."""
        target = self._target
        try:
            if self._active is not None and not self.shell.alive:
                self._set_active(None)
                self.shell.close()
            if self._active is None:  # a known state: nothing is active
                for name in self._actions:
                    self._run(name, "stop")
                self._set_active(())
            if self._active != target:
                self._change(self._active or (), target)
        except InstrumentError as error:
            self._set_active(None)
            return self.failed(error, _RETRY_S)
        return self.timebase.now_s() + _PERIOD_S

    def close(self) -> None:
        """Close the shell."""
        self.shell.close()

    def _change(self, active: tuple[str, ...], target: tuple[str, ...]) -> None:
        for name in reversed(active):
            if name not in target:
                self._run(name, "stop")
        for name in target:
            if name not in active:
                self._run(name, "start")
        self._set_active(target)

    def _set_active(self, actions: tuple[str, ...] | None) -> None:
        self._active = actions
        if actions != self._posted:
            self._posted = actions
            self.post(LoadState(self.timebase.now_s(), actions))

    def _run(self, name: str, what: str) -> None:
        action = self._actions[name]
        status = self.shell.run(action.start if what == "start" else action.stop).status
        if status:
            raise InstrumentError(
                DEVICE, self.shell.label, f"action {name} to {what}", f"exit status {status}", _FAILED
            )
