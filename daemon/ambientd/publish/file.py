"""A file like a thermal zone's ``temp``: integer millidegrees and a newline, at most 15 bytes, never empty.

Each value is a new file, renamed over the last; ``mode: in-place`` makes it :mod:`ambientd.publish.file_in_place`. A
value that is no longer trusted does not stay: the file is removed, or holds the configured poison. Nor does one stay
that cannot be replaced, or whose daemon ends. The status and the textfile are such files with other contents.
"""

import os
from collections.abc import Callable
from typing import Any, NamedTuple

from ambientd.publish import Quiet
from ambientd.publish.claims import open_own
from ambientd.publish.spec import Spec
from ambientd.publish.swap import give_up, put, remove, sweep
from ambientd.report import Report

KEYS = ("mode", "poison_millidegC", "offset_millidegC", "at_exit")
MILLIDEGREES_LIMIT = 10**12
"""Below it, an offset included, sign, digits and newline stay within the 15 bytes that such readers take at once."""
_FLOAT_LIMIT = MILLIDEGREES_LIMIT - 1.0  # an integer takes longer to compare with a float
_OFFSET_LIMIT_MILLIDEGC = 10**6
_KIND_OF_MODE = {"rename": "file", "in-place": "file-in-place"}
_AT_EXIT = ("remove", "poison")

NoteFault = Callable[[str, str, str], None]


class Options(NamedTuple):
    """What is configured of a file."""

    poison_millidegC: int | None = None
    """The content instead of a value that is not trusted; None removes the file."""
    offset_millidegC: int = 0
    """Added to the value, for a reader that knows no negative numbers; not to the poison."""
    at_exit: str = "remove"
    """Whether the file is removed when the daemon ends, or stays with the poison."""


def publisher(spec: Spec, patience_ms: int | None) -> "RenamedFile":
    """A file that is renamed over the last."""
    return RenamedFile(spec)


def configured(spec: Spec, place: str, data: dict[str, Any], fault: NoteFault) -> Spec:
    """``spec`` with the keys of ``data``; ``fault`` takes place, problem and hint of each that is wrong."""

    def choice(key: str, known: tuple[str, ...]) -> str:
        if data[key] not in known:
            fault(f"{place}.{key}", f"is {data[key]!r}", f"one of {', '.join(known)} is wanted")
            return known[0]
        return str(data[key])

    def millidegrees(key: str, limit: int) -> int:
        if type(data[key]) is not int or abs(data[key]) >= limit:
            digits = len(str(limit - 1))
            hint = f"an integer in millidegrees, of at most {digits} digits, is wanted"
            fault(f"{place}.{key}", f"is {data[key]!r}", hint)
            return 0
        return int(data[key])

    options = Options()
    if "mode" in data:
        spec = spec._replace(kind=_KIND_OF_MODE[choice("mode", tuple(_KIND_OF_MODE))])
    if "poison_millidegC" in data:
        options = options._replace(poison_millidegC=millidegrees("poison_millidegC", MILLIDEGREES_LIMIT))
    if "offset_millidegC" in data:
        options = options._replace(offset_millidegC=millidegrees("offset_millidegC", _OFFSET_LIMIT_MILLIDEGC))
    if "at_exit" in data:
        options = options._replace(at_exit=choice("at_exit", _AT_EXIT))
    if (options.at_exit, options.poison_millidegC) == ("poison", None):
        fault(f"{place}.at_exit", "there is no poison to leave", "give poison_millidegC, too")
    return spec if options == Options() else spec._replace(options=options)


def content(report: Report, spec: Spec) -> bytes | None:
    """The file's content for ``report``, or None where there is to be no file."""
    ambient_degC, options = report.estimate.ambient_degC, spec.options
    if ambient_degC is not None and -_FLOAT_LIMIT < (millidegC := ambient_degC * 1000) < _FLOAT_LIMIT:
        return b"%d\n" % (round(millidegC) if options is None else round(millidegC) + options.offset_millidegC)
    return poison(spec)


def poison(spec: Spec) -> bytes | None:
    """The configured poison, if any."""
    millidegC = None if spec.options is None else spec.options.poison_millidegC
    return None if millidegC is None else b"%d\n" % millidegC


def poison_at_exit(spec: Spec) -> bytes | None:
    """The poison that stays when the daemon ends, if any."""
    return poison(spec) if spec.options is not None and spec.options.at_exit == "poison" else None


def overwrite(descriptor: int, content: bytes, length: int) -> None:
    """Put ``content`` in place of what is ``length`` bytes long; raises OSError.

    In one write: it makes newlines of what is left of a longer content, which is cut off afterwards. A shorter content
    is lengthened first: a concurrent reader would otherwise read the new digits only as far as the old content reached.
    """
    if len(content) > length:
        os.pwrite(descriptor, b"\n" * (len(content) - length), length)
    os.pwrite(descriptor, content.ljust(length, b"\n"), 0)
    if len(content) < length:
        os.ftruncate(descriptor, len(content))


class RenamedFile(Quiet):
    """Each value is a new file, renamed over the last: for readers that open it anew each time."""

    def __init__(
        self, spec: Spec, content: Callable[[Report, Spec], bytes | None] = content, last: bool = False
    ) -> None:
        self._spec = spec
        self._content = content
        self.last = last
        sweep(spec.path)

    def adapt(self, spec: Spec) -> None:
        """Use ``spec`` from the next value on."""
        self._spec = spec

    def publish(self, report: Report | None) -> None:
        """Put the value, the poison or nothing in place; None stands for the daemon's end. Raises OSError."""
        value = poison_at_exit(self._spec) if report is None else self._content(report, self._spec)
        if value is None:
            return self._remove()
        try:
            self._put(value)
        except OSError:
            try:
                self._withdraw()
            except OSError:
                pass
            raise

    def _put(self, value: bytes) -> None:
        os.close(put(self._spec.path, value, self._spec.access))

    def _remove(self) -> None:
        remove(self._spec.path)

    def _withdraw(self) -> None:
        """Remove the value that is there. Even a full disk has room for the poison in its place."""
        instead = poison(self._spec)
        if instead is not None:
            try:
                descriptor = open_own(self._spec.path, self._spec.access.owner)
                try:
                    return overwrite(descriptor, instead, os.fstat(descriptor).st_size)
                finally:
                    os.close(descriptor)
            except OSError:
                pass
        os.unlink(self._spec.path)

    def close(self) -> None:
        """Remove the file, or leave the poison in it; raises OSError."""
        give_up(self._spec.path)
        self.publish(None)
