"""Forward form of a circuit: ambient and inputs in, the temperature of each measured node out.

In ``rise`` form (the thesis's) the sensors are inputs and the ambient comes out. Turned round, nodes with a heat
capacity are states that their sensors measure, nodes without one stay prescribed by theirs, and the ambient is
prescribed by the reference.
"""

from dataclasses import replace

from ambient_model.faults import refuse
from ambient_trainer.circuits.circuit import AMBIENT, Circuit, Node, Output, Parameter

REFERENCE_SENSOR = "ambient"


def forward(circuit: Circuit) -> Circuit:
    """``circuit`` with the ambient prescribed and every sensor on a state as an output; raises :class:`Refused`."""
    ambient = Node(AMBIENT, None, REFERENCE_SENSOR)
    nodes = tuple(ambient if node.name == AMBIENT else node for node in circuit.nodes)
    if any(AMBIENT in edge.between for edge in circuit.edges) and ambient not in nodes:
        nodes = (*nodes, ambient)
    if all(node.capacitance is not None for node in nodes):
        hint = "join a node to the ambient: heat needs a path to a boundary"
        raise refuse(circuit.name, "nodes", "no temperature is prescribed", hint)
    read = [node for node in nodes if node.capacitance is not None and node.sensor is not None]
    if not read:
        hint = "take one with heat capacities, such as model2_ss, or write one"
        raise refuse(circuit.name, "nodes", "no sensor reads a node with a capacitance: nothing can be simulated", hint)
    unit = Parameter("whole", "1", 1.0, 1.0, 1.0, free=False)
    outputs = tuple(Output(str(node.sensor), {node.name: unit.name}, {}, None) for node in read)
    used = {node.capacitance for node in nodes} | {edge.resistance for edge in circuit.edges}
    used |= {source.share for source in circuit.sources}
    kept = tuple(each for each in circuit.parameters if each.name in used)
    return replace(circuit, form="temperature", nodes=nodes, outputs=outputs, parameters=(*kept, unit))
