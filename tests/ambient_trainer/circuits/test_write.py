"""What is read back from a written circuit is the same circuit, whatever is in it."""

import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.circuits.write import write_circuit

ONE_NODE = {
    "format": "ambient-circuit",
    "version": 1,
    "name": "one",
    "form": "rise",
    "nodes": {"on": {"capacitance": 1.0, "sensor": "on"}},
    "edges": [{"between": ["on", "ambient"], "resistance": 1.0}],
    "outputs": {"ambient": {"states": "parallel"}},
}


BREAKS = "\x85 or \u2028 or \n breaks a line, \ufeff none: 20 \N{DEGREE SIGN}C"


@settings(max_examples=50, deadline=None)
@given(st.from_type(Circuit))
@example(parse_circuit(yaml.safe_dump({**ONE_NODE, "about": BREAKS}), "one node"))
def test_every_circuit_comes_back(circuit):
    assert parse_circuit(write_circuit(circuit), "written") == circuit
