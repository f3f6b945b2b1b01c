"""The newest tick as one JSON object in a file, for consumers that look now and then."""

from ambientd.publish.file import RenamedFile
from ambientd.publish.spec import Spec
from ambientd.report import Report, as_json


def publisher(spec: Spec, patience_ms: int | None) -> RenamedFile:
    """A file that always holds one whole JSON object.

    It is served last: killed between two publishers, the daemon leaves no status that is newer than the other outputs.
    """
    return RenamedFile(spec, _line, last=True)


def _line(report: Report, spec: Spec) -> bytes:
    return f"{as_json(report)}\n".encode()
