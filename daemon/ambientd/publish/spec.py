"""What is published where, as the command line and the configuration name it: KIND:PATH."""

from typing import NamedTuple

from ambientd.publish.access import Access

KINDS = ("file", "file-in-place", "status", "prometheus", "socket", "stdout")
MODES = ("rename", "in-place")
AT_EXIT = ("remove", "poison")
MILLIDEGREES_LIMIT = 10**12
"""Below it, an offset included, sign, digits and newline stay within the 15 bytes that such readers take at once."""


class Spec(NamedTuple):
    """One publisher that is asked for."""

    kind: str
    path: str = ""
    mode: str = "rename"
    """How a ``file`` changes: a new file renamed over the old, or the same file written in place."""
    poison_millidegC: int | None = None
    """What a ``file`` says instead of a value that is not trusted; None removes the file."""
    offset_millidegC: int = 0
    """What is added to the value in a ``file``, for a reader that knows no negative numbers; not to the poison."""
    at_exit: str = "remove"
    """Whether a ``file`` goes when the daemon ends, or stays and says the poison."""
    access: Access = Access()

    def __str__(self) -> str:
        kind = "file-in-place" if (self.kind, self.mode) == ("file", "in-place") else self.kind
        return f"{kind}:{self.path}" if self.path else kind


def parse(text: str) -> Spec:
    """The publisher named by ``text``; raises ValueError, 'problem; mend', where it names none."""
    kind, _, path = text.partition(":")
    if kind not in KINDS:
        raise ValueError(f"{kind!r} is no kind of publisher; known are {', '.join(KINDS)}")
    if kind == "stdout" and path:
        raise ValueError(f"{text!r} has a path; stdout takes none")
    if kind != "stdout" and not path:
        raise ValueError(f"{text!r} has no path; write {kind}:PATH")
    if kind == "file-in-place":
        return Spec("file", path, mode="in-place")
    return Spec(kind, path)
