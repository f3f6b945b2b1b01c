"""Where an estimate goes: one module a kind, imported when that kind is asked for."""

from typing import Protocol

from ambientd.publish.spec import Spec
from ambientd.report import Report


class Publisher(Protocol):
    """Takes the report of each tick to a consumer."""

    def publish(self, report: Report) -> None:
        """Take ``report`` there; raises OSError where that fails."""

    def descriptor(self) -> int | None:
        """What to watch for readers that come between two ticks, if any may."""

    def serve(self) -> None:
        """Serve a reader that came; called when the descriptor is readable."""

    def adapt(self, spec: Spec) -> None:
        """Go on as ``spec`` of the same kind, mode and path says; what fails in that, fails at the next tick."""

    def close(self) -> None:
        """Leave nothing behind that could be taken for a live value."""


class Quiet:
    """A publisher that no one connects to."""

    def descriptor(self) -> int | None:
        """Nothing to watch."""
        return None

    def serve(self) -> None:
        """No one comes."""


def open_publisher(spec: Spec, patience_ms: int | None) -> Publisher:
    """The publisher that ``spec`` asks for; raises :class:`~ambient_model.faults.Refused` where it cannot start.

    ``patience_ms`` is how long a full pipe on stdout is waited for; None is for ever.
    """
    if spec.kind == "file":
        from ambientd.publish.file import InPlaceFile, RenamedFile

        return RenamedFile(spec) if spec.mode == "rename" else InPlaceFile(spec)
    if spec.kind == "status":
        from ambientd.publish.status import StatusFile

        return StatusFile(spec)
    if spec.kind == "prometheus":
        from ambientd.publish.prometheus import PrometheusFile

        return PrometheusFile(spec)
    if spec.kind == "socket":
        from ambientd.publish.socket import SocketServer

        return SocketServer(spec)
    from ambientd.publish.stdout import Stdout

    return Stdout(patience_ms)
