"""Publishers at work. One that fails is reported once and affects no other; a new set takes over without a gap."""

import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ambient_model.faults import Refused
from ambientd.notices import Notice
from ambientd.publish import Publisher, open_publisher
from ambientd.publish.claims import Claims
from ambientd.publish.proof import created, is_file, prove
from ambientd.publish.spec import Spec
from ambientd.report import Report
from ambientd.schedule import Waiter

if TYPE_CHECKING:
    from ambientd.settings import StateSpec


class Outlets:
    """The publishers at work; ``waiter`` serves those that others connect to.

    ``patience_ms`` is how long a full pipe on stdout is waited for; None is for ever.
    """

    def __init__(self, waiter: Waiter, patience_ms: int | None, note: Callable[[str], None]) -> None:
        self._waiter = waiter
        self._patience_ms = patience_ms
        self._note = note
        self._open: dict[Spec, tuple[Publisher, Notice]] = {}
        self._unpublished: set[Spec] = set()
        self._closed = False
        self._claims = Claims()
        self._paths: set[str] = set()
        """The files among what is published, and the state: no other daemon may write them."""
        self._unclaimed: set[str] = set()
        """Those of them whose folders were not there yet."""

    @property
    def unpublished(self) -> list[str]:
        """The names of those that have published nothing yet."""
        return [str(spec) for spec in self._open if spec in self._unpublished]

    def become(self, specs: Sequence[Spec], state: "StateSpec | None" = None, proved: bool = False) -> None:
        """Open what is new in ``specs``, close what is no longer there, adapt what stays; ``state`` is claimed, too.

        Raises :class:`~ambient_model.faults.Refused` where one cannot start or is another's, and, if they are to be
        ``proved``, where one that is new could not be written; then nothing has changed.
        """
        stay = {_place(spec): spec for spec in self._open}
        opened: dict[Spec, tuple[Publisher, Notice]] = {}
        paths = {each.path for each in created(specs, state) if is_file(each)}
        try:
            for path in paths:
                try:  # without a folder, at the first tick that finds one
                    self._claims.take(path)
                except OSError:
                    pass
            new = [spec for spec in specs if _place(spec) not in stay]
            if proved:
                moved = [spec for spec in specs if spec not in new and stay[_place(spec)].access != spec.access]
                changed = state if state and state.path not in self._paths else None
                if faults := prove(created([*new, *moved], changed), lambda *_: None):
                    raise Refused("publish", faults)
            for spec in new:
                opened[spec] = (open_publisher(spec, self._patience_ms), Notice())
        except BaseException:
            for spec, (publisher, _) in opened.items():
                self._close(spec, publisher)
            self._claims.keep(self._paths)
            raise
        for spec in specs:
            before = stay.pop(_place(spec), None)
            if before is not None:
                opened[spec] = self._open.pop(before)
                self._adapt(before, spec, opened[spec][0])
                continue
            self._unpublished.add(spec)
            if (descriptor := opened[spec][0].descriptor()) is not None:
                self._waiter.serve(descriptor, opened[spec][0].serve)
        for spec, (publisher, _) in self._open.items():
            if (descriptor := publisher.descriptor()) is not None:
                self._waiter.forget(descriptor)
            self._unpublished.discard(spec)
            self._close(spec, publisher)
        self._open = {spec: opened[spec] for spec in sorted(specs, key=lambda spec: opened[spec][0].last)}
        self._paths = paths
        self._claims.keep(paths)
        self._unclaimed = paths - self._claims.held.keys()
        self._report_unused()

    def _report_unused(self) -> None:
        """Report each socket that was handed over and is not served: its clients wait."""
        if not any(name == "LISTEN_FDS" or name.startswith("ANDROID_SOCKET_") for name in os.environ):
            return
        from ambientd.publish.inherited import handed_over

        served = [
            os.path.abspath(spec.path) for spec, (open_, _) in self._open.items() if open_.descriptor() is not None
        ]
        for path in handed_over(os.environ):
            if path not in served:
                self._note(f"{path}: was handed over and is not served; publish 'socket:{path}', or do not make it")

    def _adapt(self, before: Spec, spec: Spec, publisher: Publisher) -> None:
        if before != spec:
            publisher.adapt(spec)
            if before in self._unpublished:
                self._unpublished.remove(before)
                self._unpublished.add(spec)

    def publish(self, report: Report) -> None:
        """Take ``report`` to each."""
        for spec, (publisher, notice) in self._open.items():
            if self._closed:  # while this thread hung
                return
            problem = ""
            try:
                if self._unclaimed and spec.path in self._unclaimed:
                    self._claims.take(spec.path)
                    self._unclaimed.discard(spec.path)
                publisher.publish(report)
                if self._unpublished:
                    self._unpublished.discard(spec)
            except Refused as refused:
                problem = refused.faults[0].problem
            except OSError as error:
                problem = error.strerror or str(error)
            if (problem or notice.wrong) and notice.changed(report.time_s, bool(problem)):
                self._note(f"{spec}: {f'cannot be written ({problem}); the others go on' if problem else 'is back'}")

    def __enter__(self) -> "Outlets":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all: no value stays behind."""
        self._closed = True
        for spec, (publisher, _) in self._open.items():
            self._close(spec, publisher)
        self._open = {}
        self._claims.keep(())

    def _close(self, spec: Spec, publisher: Publisher) -> None:
        try:
            publisher.close()
        except OSError as error:
            self._note(f"{spec}: cannot be removed ({error.strerror or error})")


def _place(spec: Spec) -> tuple[str, str]:
    """Identity of a publisher; it can adapt to everything else."""
    return spec.kind, spec.path
