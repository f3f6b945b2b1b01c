"""Each publisher fails alone: it is told of once, and stops nothing. Another set takes over without a gap."""

import os
from collections.abc import Callable, Sequence

from ambientd.notices import Notice
from ambientd.publish import Publisher, open_publisher
from ambientd.publish.spec import Spec
from ambientd.report import Report
from ambientd.schedule import Waiter


class Outlets:
    """The publishers at work; ``waiter`` serves those that others connect to.

    ``patience_ms`` is how long a full pipe on stdout is waited for; None is for ever.
    """

    def __init__(self, waiter: Waiter, patience_ms: int | None, note: Callable[[str], None]) -> None:
        self._waiter = waiter
        self._patience_ms = patience_ms
        self._note = note
        self._open: dict[Spec, tuple[Publisher, Notice]] = {}
        self._heard: set[Spec] = set()

    @property
    def unheard(self) -> list[str]:
        """The names of those that have not published anything yet."""
        return [str(spec) for spec in self._open if spec not in self._heard]

    def become(self, specs: Sequence[Spec]) -> None:
        """Open what is new in ``specs``, close what is no longer there, and tell what stays how it is to go on.

        Raises :class:`~ambient_model.faults.Refused` where one cannot start, and then nothing has changed.
        """
        stay = {_place(spec): spec for spec in self._open}
        opened: dict[Spec, tuple[Publisher, Notice]] = {}
        try:
            for spec in specs:
                if _place(spec) not in stay:
                    opened[spec] = (open_publisher(spec, self._patience_ms), Notice())
        except BaseException:
            for spec, (publisher, _) in opened.items():
                self._close(spec, publisher)
            raise
        for spec in specs:
            before = stay.pop(_place(spec), None)
            if before is not None:
                opened[spec] = self._open.pop(before)
                self._adapt(before, spec, opened[spec][0])
            elif (descriptor := opened[spec][0].descriptor()) is not None:
                self._waiter.serve(descriptor, opened[spec][0].serve)
        for spec, (publisher, _) in self._open.items():
            if (descriptor := publisher.descriptor()) is not None:
                self._waiter.forget(descriptor)
            self._heard.discard(spec)
            self._close(spec, publisher)
        # killed between two of them, it must not leave a status that is newer than what it speaks of
        self._open = {spec: opened[spec] for spec in sorted(specs, key=_says_status)}
        self._tell_unused()

    def _tell_unused(self) -> None:
        """A socket that was handed over and is not served keeps its clients waiting."""
        if not any(name == "LISTEN_FDS" or name.startswith("ANDROID_SOCKET_") for name in os.environ):
            return
        from ambientd.publish.inherited import handed_over

        served = [os.path.abspath(spec.path) for spec in self._open if spec.kind == "socket"]
        for path in handed_over(os.environ):
            if path not in served:
                self._note(f"{path}: was handed over, and no one serves it; publish 'socket:{path}', or do not make it")

    def _adapt(self, before: Spec, spec: Spec, publisher: Publisher) -> None:
        if before != spec:
            publisher.adapt(spec)
            if before in self._heard:
                self._heard.remove(before)
                self._heard.add(spec)

    def publish(self, report: Report) -> None:
        """Take ``report`` to each."""
        for spec, (publisher, notice) in self._open.items():
            problem = ""
            try:
                publisher.publish(report)
                self._heard.add(spec)
            except OSError as error:
                problem = error.strerror or str(error)
            if notice.changed(report.time_s, bool(problem)):
                self._note(f"{spec}: {f'cannot be written ({problem}); the others go on' if problem else 'is back'}")

    def close(self) -> None:
        """Close all: nothing stays behind that could be taken for a live value."""
        for spec, (publisher, _) in self._open.items():
            self._close(spec, publisher)
        self._open = {}

    def _close(self, spec: Spec, publisher: Publisher) -> None:
        try:
            publisher.close()
        except OSError as error:
            self._note(f"{spec}: cannot be removed ({error.strerror or error})")


def _says_status(spec: Spec) -> bool:
    return spec.kind == "status"


def _place(spec: Spec) -> tuple[str, str, str]:
    """What makes another publisher of one; all else it can adapt to."""
    return spec.kind, spec.mode, spec.path
