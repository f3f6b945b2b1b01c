"""Configuration and model are read, checked and decoded in a child process: its modules and its memory go with it.

What the child makes of them comes back as plain data and byte code through a pipe, so that the process that ticks for
months imports neither argparse nor json nor any of the checks, and compiles nothing.
"""

import _signal as signal  # type: ignore[import-not-found]  # whose public name takes enum and functools along
import marshal
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

from ambient_model.faults import Fault, Refused, refuse
from ambientd import lean
from ambientd.settings import Prepared, Settings


def prepare(settings: Settings) -> Prepared:
    """Read the model of ``settings``; raises :class:`Refused`."""
    from ambient_model.codec import load_model
    from ambient_model.model import Conformance
    from ambientd.fallback import usual_code

    model = load_model(settings.model)
    identity = ""
    if settings.state is not None:
        from ambientd.state import model_identity

        identity = model_identity(model)
    bare = model._replace(provenance={}, conformance=Conformance((), {}))
    return Prepared(settings, bare, identity, usual_code(model, 1 / settings.rate_hz, settings.level_percent))


class Child:
    """A child process that calls ``call``."""

    def __init__(self, call: Callable[[], Any]) -> None:
        self._pipe, there = os.pipe()
        self._process = os.fork()
        if self._process == 0:
            try:
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches both: the parent answers it
                os.close(self._pipe)
                lean.restore()
                content = marshal.dumps(_flat(_outcome(call)))
                sys.stdout.flush()
                while content:
                    content = content[os.write(there, content) :]
            except (KeyboardInterrupt, BrokenPipeError):  # one that came before, or a parent that is gone
                pass
            except BaseException:
                sys.excepthook(*sys.exc_info())
            finally:
                os._exit(0)
        os.close(there)

    def result(self) -> Any:
        """What ``call`` returned; raises :class:`Refused` or SystemExit where it did."""
        with open(self._pipe, "rb") as stream:
            content = stream.read()
        os.waitpid(self._process, 0)
        if not content:
            raise refuse("ambientd", "", "the process that reads the configuration was ended", "start it again")
        kind, value = _built(marshal.loads(content))
        if kind == "refused":
            raise Refused(*value)
        if kind == "exit":
            raise SystemExit(value)
        return value


def _outcome(call: Callable[[], Any]) -> tuple[str, Any]:
    try:
        return "done", call()
    except Refused as refused:
        return "refused", [refused.source, list(refused.faults)]
    except SystemExit as end:
        return "exit", end.code
    except OSError as error:
        return "refused", [
            error.filename or "ambientd",
            [Fault("", error.strerror or str(error), "see that it is there")],
        ]


def _flat(value: Any) -> Any:
    """``value`` in types that marshal knows: a named tuple becomes a list of its class and fields."""
    if isinstance(value, Mapping):
        return {key: _flat(each) for key, each in value.items()}
    if not isinstance(value, (tuple, list)):
        return value
    flat = tuple([_flat(each) for each in value])
    return flat if type(value) in (tuple, list) else [type(value).__module__, type(value).__name__, flat]


def _built(value: Any) -> Any:
    """The reverse of :func:`_flat`, but for lists, which become tuples."""
    if isinstance(value, dict):
        return {key: _built(each) for key, each in value.items()}
    if isinstance(value, tuple):
        return tuple([_built(each) for each in value])
    if isinstance(value, list):
        module, name, fields = value
        __import__(module)
        return getattr(sys.modules[module], name)(*_built(fields))
    return value
