"""A circuit is data: nodes, edges, sources, what reads what, and which of its parameters are to be found.

Two forms share the data. In ``temperature`` form the states are the nodes' temperatures, and every exchange between
nodes is simulated; the inputs are the prescribed nodes and the source signals. In ``rise`` form (the thesis, equation
4.5) the states are the nodes' rises over the unknown ambient; the exchange between nodes follows from the sensors'
readings, which are the inputs, and only the loss to the ambient acts on the states.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ambient_trainer.lti.statespace import Hold

AMBIENT = "ambient"

Form = Literal["rise", "temperature"]


@dataclass(frozen=True)
class Parameter:
    """A number of the circuit: searched where ``free``, else held at ``initial``."""

    name: str
    unit: str
    initial: float
    low: float
    high: float
    free: bool


@dataclass(frozen=True)
class Node:
    """A place with one temperature.

    With a ``capacitance`` (the name of a parameter, J/K) it is a state; without one its ``sensor`` prescribes its
    temperature, or it is the unknown ambient.
    """

    name: str
    capacitance: str | None
    sensor: str | None
    """The trace column, without its unit, that reads this node."""


@dataclass(frozen=True)
class Edge:
    """A thermal resistance (the name of a parameter, K/W) between two nodes."""

    between: tuple[str, str]
    resistance: str

    def other(self, node: str) -> str:
        """The node at the other end."""
        return self.between[1] if self.between[0] == node else self.between[0]


@dataclass(frozen=True)
class Source:
    """Heat into a node: ``share`` (a parameter, W per unit of the signal) times ``signal`` (a trace column)."""

    into: str
    signal: str
    share: str


@dataclass(frozen=True)
class Output:
    """A temperature that the circuit predicts: weighted states plus weighted inputs plus an offset.

    ``states`` maps nodes to parameters; None stands for the nodes' shares of the conductance to the ambient, with the
    sign of the form (thesis equations 4.11 and 4.16). ``inputs`` maps trace columns to parameters.
    """

    name: str
    states: Mapping[str, str] | None
    inputs: Mapping[str, str]
    offset: str | None
    heat: str | None = None
    """A parameter in W: the ambient balances this heat and what the measured nodes give off to it (equation 4.4).

    It adds (sum G_i T_i + heat) / sum G, where G_i = 1/R_i leads from a measured node to the ambient.
    """

    @property
    def column(self) -> str:
        """The trace column that it is compared with."""
        return f"{self.name}_degC"


@dataclass(frozen=True)
class Addition:
    """A mechanism beyond resistances, capacitances and sources, as ``diagnose`` finds them; it interprets the ``kind``.

    ``numbers`` holds for each number its unit, value, whether it is positive (``log``) and its ``scale``.
    """

    kind: str
    at: tuple[str, ...]
    by: str | None
    from_s: float | None
    to_s: float | None
    numbers: Mapping[str, Mapping[str, Any]]
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class Circuit:
    """A validated thermal circuit; see ``circuits/schema.py`` for the file it comes from."""

    name: str
    about: str
    form: Form
    hold: Hold
    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    sources: tuple[Source, ...]
    outputs: tuple[Output, ...]
    parameters: tuple[Parameter, ...]
    mechanisms: tuple[Addition, ...] = ()

    @property
    def states(self) -> tuple[Node, ...]:
        """The nodes with a heat capacity, in order."""
        return tuple(node for node in self.nodes if node.capacitance is not None)

    @property
    def measured(self) -> tuple[Node, ...]:
        """The nodes whose sensor drives the circuit, in order."""
        return tuple(node for node in self.nodes if node.sensor and (self.form == "rise" or node.capacitance is None))

    @property
    def inputs(self) -> tuple[str, ...]:
        """The trace columns that drive the circuit, in order."""
        signals = [source.signal for source in self.sources]
        return tuple(dict.fromkeys([*(f"{node.sensor}_degC" for node in self.measured), *signals]))

    def to_ambient(self, nodes: Sequence[Node]) -> list[tuple[str, str]]:
        """Per edge between one of ``nodes`` and the ambient, the node's name and the resistance's, in their order."""
        return [
            (node.name, edge.resistance)
            for node in nodes
            for edge in self.edges
            if set(edge.between) == {node.name, AMBIENT}
        ]
