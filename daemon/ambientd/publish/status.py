"""The newest tick as one JSON object in a file, for whoever looks in from time to time."""

from ambientd.publish import Quiet
from ambientd.publish.swap import remove, swap_in
from ambientd.report import Report, as_json


class StatusFile(Quiet):
    """A file that always holds one whole JSON object."""

    def __init__(self, path: str) -> None:
        self._path = path

    def publish(self, report: Report) -> None:
        """Replace the object; raises OSError."""
        swap_in(self._path, f"{as_json(report)}\n".encode())

    def close(self) -> None:
        """Remove the file."""
        remove(self._path)
