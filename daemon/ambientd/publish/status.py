"""The newest tick as one JSON object in a file, for consumers that look now and then."""

from ambientd.publish import Quiet
from ambientd.publish.spec import Spec
from ambientd.publish.swap import remove, swap_in, sweep
from ambientd.report import Report, as_json


def publisher(spec: Spec, patience_ms: int | None) -> "StatusFile":
    """A file with the newest tick."""
    return StatusFile(spec)


class StatusFile(Quiet):
    """A file that always holds one whole JSON object."""

    last = True
    """Killed between two publishers, the daemon leaves no status that is newer than the other outputs."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        sweep(spec.path)

    def adapt(self, spec: Spec) -> None:
        """Use ``spec`` from the next tick on."""
        self._spec = spec

    def publish(self, report: Report) -> None:
        """Replace the object; raises OSError."""
        swap_in(self._spec.path, f"{as_json(report)}\n".encode(), self._spec.access)

    def close(self) -> None:
        """Remove the file."""
        remove(self._spec.path)
