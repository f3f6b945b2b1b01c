"""Each publisher fails alone: it is told of once, and stops nothing. Another set takes over without a gap."""

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
        """Open what is new in ``specs`` and close what is no longer there; what stays is not touched.

        Raises :class:`~ambient_model.faults.Refused` where one cannot start, and then nothing has changed.
        """
        opened: dict[Spec, tuple[Publisher, Notice]] = {}
        try:
            for spec in specs:
                if spec not in self._open:
                    opened[spec] = (open_publisher(spec, self._patience_ms), Notice())
        except BaseException:
            for spec, (publisher, _) in opened.items():
                self._close(spec, publisher)
            raise
        for spec, (publisher, _) in self._open.items():
            if spec not in specs:
                descriptor = publisher.descriptor()
                if descriptor is not None:
                    self._waiter.forget(descriptor)
                self._heard.discard(spec)
                self._close(spec, publisher)
        for publisher, _ in opened.values():
            descriptor = publisher.descriptor()
            if descriptor is not None:
                self._waiter.serve(descriptor, publisher.serve)
        known = {**self._open, **opened}
        self._open = {spec: known[spec] for spec in specs}

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
