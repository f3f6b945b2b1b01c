"""Contact of a node with a body at its own temperature for some time: a hand, a table, a pocket."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.mechanisms import Joined
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record

_BODY_DEGC, _BODY_SD_K = 33.0, 5.0
"""Of a hand: its skin, and how much skin differs and what is worn or laid beneath."""


@dataclass(frozen=True)
class Contact(Joined):
    """A conductance to a body, and the body's temperature, within a window."""

    cause = "contact"
    noun = "contact with an external body"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        conductance = values[:, :1, None] * self.weight(record)
        network.vary([network.index(self.places[0])], conductance, values[:, 1:2, None])


def begun(context: Context) -> Iterator[Mechanism]:
    """A contact of each node: between a warm body and cold air heat changes its sign, so its window is its own."""
    return (_contact(context, each) for each in context.nodes)


def beside(context: Context, placed: Mechanism) -> Iterator[Mechanism]:
    """A contact in the window in which heat into one node explains something."""
    if len(placed.places) == 1 and placed.cause == "heat_source":
        yield replace(_contact(context, placed.places[0]), onset_s=placed.onset_s, end_s=placed.end_s)


def _contact(context: Context, node: str) -> Contact:
    conductance = Number(f"G_{node}_body", "W/K", context.conductance(node), log=True)
    body = Number(f"body_{node}", "degC", _BODY_DEGC, low=-60.0, high=150.0, prior_sd=_BODY_SD_K)
    return Contact((node,), (conductance, body))
