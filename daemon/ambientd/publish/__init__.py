"""Where an estimate goes: one module a kind, imported when that kind is asked for.

A new kind is one new module ``ambientd/publish/KIND.py``; ``KIND:PATH`` then publishes to it. It has

- ``publisher(spec, patience_ms)``, which returns a :class:`Publisher` or raises
  :class:`~ambient_model.faults.Refused` where it cannot start; ``patience_ms`` is how long a full pipe may be waited
  for, None is for ever;
- where it needs no path: ``TAKES_PATH = False``;
- where it has keys of its own in the configuration: ``KEYS``, their names, and ``configured(spec, place, data,
  fault)``, which returns the spec with :attr:`Spec.options <ambientd.publish.spec.Spec.options>` set;
- where its output is no plain file: ``foreseen(spec)``, what ``ambientd check`` prints of it, or OSError.
"""

from typing import Protocol

from ambientd.publish.spec import Spec, kind_module
from ambientd.report import Report


class Publisher(Protocol):
    """Takes the report of each tick to a consumer."""

    last: bool
    """Whether it is served after the others at each tick, as it reports on them."""

    def publish(self, report: Report) -> None:
        """Take ``report`` there; raises OSError where that fails."""

    def descriptor(self) -> int | None:
        """The descriptor to watch for consumers that connect between two ticks, if any may."""

    def serve(self) -> None:
        """Serve a consumer that connected; called when the descriptor is readable."""

    def adapt(self, spec: Spec) -> None:
        """Continue as ``spec``, of the same kind and path, configures; what fails then, fails at the next tick."""

    def close(self) -> None:
        """Leave nothing behind that could be taken for a current value."""


class Quiet:
    """A publisher that no consumer connects to."""

    last = False

    def descriptor(self) -> int | None:
        """Nothing to watch."""
        return None

    def serve(self) -> None:
        """Nothing to serve."""


def open_publisher(spec: Spec, patience_ms: int | None) -> Publisher:
    """The publisher of ``spec``; raises :class:`~ambient_model.faults.Refused` where it cannot start."""
    opened: Publisher = kind_module(spec.kind).publisher(spec, patience_ms)
    return opened
