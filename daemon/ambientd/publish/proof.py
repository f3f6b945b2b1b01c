"""What each output would be, found out without touching what is there: before a reload, and for ``ambientd check``."""

import errno
import os
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from ambient_model.faults import Fault
from ambientd.publish.spec import Spec, kind_module
from ambientd.publish.swap import trial

if TYPE_CHECKING:
    from ambientd.settings import StateSpec

    Output = Spec | StateSpec


def created(specs: Iterable[Spec], state: "StateSpec | None") -> "list[Output]":
    """All that lies somewhere."""
    outputs: list[Output] = [spec for spec in specs if spec.path]
    return [*outputs, state] if state else outputs


def foreseen(output: "Output") -> str:
    """Mode and owner of what would be made; raises OSError where it could not be."""
    own = getattr(kind_module(output.kind), "foreseen", None) if isinstance(output, Spec) else None
    if own is not None:
        return str(own(output))
    if os.path.isdir(output.path):
        raise OSError(errno.EISDIR, "it is a folder")
    return trial(output.path, output.access)


def is_file(output: "Output") -> bool:
    """Whether it is a plain file."""
    return not (isinstance(output, Spec) and hasattr(kind_module(output.kind), "foreseen"))


def name_of(output: "Output") -> str:
    """As messages show it."""
    return str(output) if isinstance(output, Spec) else f"state:{output.path}"


def prove(outputs: "Iterable[Output]", report: Callable[[str, str], None]) -> list[Fault]:
    """What is wrong with each that could not be written; ``report`` takes name and :func:`foreseen` of the others."""
    faults = []
    for each in outputs:
        try:
            report(name_of(each), foreseen(each))
        except OSError as error:
            problem = f"cannot be written ({error.strerror or error})"
            faults.append(Fault(f"output {name_of(each)}", problem, _hint(error)))
    return faults


def _hint(error: OSError) -> str:
    if error.errno == errno.EPERM:
        return (
            "let the daemon run with that group, or with CAP_CHOWN and, under systemd, SystemCallFilter=@chown;"
            " and check as the user that it runs as"
        )
    return "choose another path, or see that the user that the daemon runs as may write there, and check as that user"
