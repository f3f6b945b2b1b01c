"""Thermal circuits as data: read from YAML, assembled into state spaces, extended, written back."""

from ambient_trainer.circuits.assemble import Assembled, assemble
from ambient_trainer.circuits.circuit import AMBIENT, Circuit, Edge, Form, Node, Output, Parameter, Source
from ambient_trainer.circuits.schema import circuit_names, circuit_of_data, load_circuit, parse_circuit
from ambient_trainer.circuits.write import save_circuit, write_circuit
