"""The newest tick as one JSON object in a file, for whoever looks in from time to time."""

from ambientd.publish import Quiet
from ambientd.publish.spec import Spec
from ambientd.publish.swap import remove, swap_in, sweep
from ambientd.report import Report, as_json


class StatusFile(Quiet):
    """A file that always holds one whole JSON object."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        sweep(spec.path)

    def adapt(self, spec: Spec) -> None:
        """Let ``spec`` hold from the next tick on."""
        self._spec = spec

    def publish(self, report: Report) -> None:
        """Replace the object; raises OSError."""
        swap_in(self._spec.path, f"{as_json(report)}\n".encode(), self._spec.access)

    def close(self) -> None:
        """Remove the file."""
        remove(self._spec.path)
