"""What is published where, as the command line and the configuration name it: KIND:PATH."""

from typing import Any, NamedTuple

from ambientd.kinds import known, module_of
from ambientd.publish.access import Access

_PACKAGE, _FUNCTION = "ambientd.publish", "publisher"


class Spec(NamedTuple):
    """One publisher that is asked for."""

    kind: str
    path: str = ""
    access: Access = Access()
    options: Any = None
    """The kind's own keys, as its module reads them; None where none is given."""

    def __str__(self) -> str:
        return f"{self.kind}:{self.path}" if self.path else self.kind


def kinds() -> list[str]:
    """The names of all kinds. It imports them all: for messages and help only."""
    return list(known(_PACKAGE, _FUNCTION))


def kind_module(kind: str) -> Any:
    """The module of a kind; raises ValueError, 'problem; hint', where there is none."""
    module = module_of(_PACKAGE, kind, _FUNCTION)
    if module is None:
        raise ValueError(f"{kind!r} is no kind of publisher; known are {', '.join(kinds())}")
    return module


def parse(text: str) -> Spec:
    """The publisher named by ``text``; raises ValueError, 'problem; hint', where it names none."""
    kind, _, path = text.partition(":")
    takes_path = getattr(kind_module(kind), "TAKES_PATH", True)
    if path and not takes_path:
        raise ValueError(f"{text!r} has a path; {kind} takes none")
    if takes_path and not path:
        raise ValueError(f"{text!r} has no path; write {kind}:PATH")
    return Spec(kind.replace("_", "-"), path)
