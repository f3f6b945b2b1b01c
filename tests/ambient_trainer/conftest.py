"""Small circuits with known parameters, data made of them by integration, and problems solved the slow way."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import load_circuit, parse_circuit
from ambient_trainer.data.plugins import plugin_names
from ambient_trainer.lti.discretise import discretised
from ambient_trainer.lti.statespace import StateSpace

REPOSITORY = Path(__file__).parents[2]
CIRCUITS = REPOSITORY / "tests" / "data" / "circuits"


@pytest.fixture
def seed() -> int:
    """Another one each time; a test that fails says which."""
    return int(np.random.default_rng().integers(1 << 30))


@pytest.fixture(scope="session")
def described() -> Path:
    """Maps and circuits of the measured files; the data themselves are never copied."""
    return REPOSITORY / "tests" / "data" / "measured"


@pytest.fixture
def plugged(tmp_path, monkeypatch) -> Iterator[Callable[[ModuleType, str, str], None]]:
    """Puts a module beside those of a package: a plug-in that is one file."""

    def put(package: ModuleType, name: str, text: str) -> None:
        folder = tmp_path / "plug-ins"
        folder.mkdir()
        (folder / f"{name}.py").write_text(text)
        monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder)])
        plugin_names.cache_clear()

    yield put
    plugin_names.cache_clear()


@pytest.fixture
def forward():
    """The circuit whose nodes are all measured; its initial values are the truth."""
    return load_circuit(str(CIRCUITS / "three_nodes.yaml"))


@pytest.fixture
def rise():
    """A circuit in rise form with known heat capacities; its initial values are the truth."""
    return load_circuit(str(CIRCUITS / "rise.yaml"))


def in_air(names: str, capacitance_J_K: float, resistance_K_W: float, sources: str = "") -> Circuit:
    """Nodes apart in air, each read by a sensor of its name; their parameters are ``C_`` and ``R_`` with the name."""
    first, *_ = each_name = names.split()
    nodes = [f"{each}: {{capacitance: C_{each}, sensor: {each}}}" for each in each_name]
    edges = [f"{{between: [{each}, ambient], resistance: R_{each}}}" for each in each_name]
    parameters = [f"C_{each}: {{unit: J/K, initial: {capacitance_J_K}}}" for each in each_name]
    parameters += [f"R_{each}: {{unit: K/W, initial: {resistance_K_W}}}" for each in each_name]
    text = f"""
format: ambient-circuit
version: 1
name: {first}
about: Nodes in air
form: temperature
nodes: {{{", ".join(nodes)}, ambient: {{sensor: ambient}}}}
edges: [{", ".join(edges)}]
{sources}
outputs: sensors
parameters: {{{", ".join(parameters)}}}
"""
    return parse_circuit(text, f"{first}.yaml")


def run_loop(discrete: StateSpace, inputs: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The outputs (q, N) by the plain recursion, one sample at a time."""
    outputs = []
    for u in inputs.T:
        outputs.append(discrete.C @ x + discrete.D @ u + discrete.offset)
        x = discrete.A @ x + discrete.B @ u
    return np.array(outputs).T


def truth_of(circuit: Circuit) -> dict[str, float]:
    """The initial values of a circuit's parameters."""
    return {each.name: each.initial for each in circuit.parameters}


def response_of(circuit: Circuit, u: np.ndarray, start=None, values: dict[str, float] | None = None) -> np.ndarray:
    """What a circuit makes of inputs, one a second, by the plain recursion: from rest, at its initial values."""
    discrete = discretised(assemble(circuit, values or truth_of(circuit)).value, 1.0, circuit.hold)
    return run_loop(discrete, u, rest(discrete, u[:, 0]) if start is None else np.array(start))


def rise_inputs(random: np.random.Generator, samples: int, hold: int = 100) -> np.ndarray:
    """What the rise circuit reads: two sensors that wander, and a hot one at levels that it keeps for ``hold`` s."""
    wander = np.cumsum(random.normal(size=(2, samples)), axis=1) * [[0.2], [0.1]]
    hot = np.repeat(random.choice([30.0, 40.0, 55.0], samples // hold + 1), hold)[:samples]
    return np.vstack([25 + wander[0], 24 + wander[1], hot])


def rest(discrete: StateSpace, u: np.ndarray) -> np.ndarray:
    """The state of a discrete system that has seen ``u`` for ever."""
    return np.linalg.solve(np.eye(len(discrete.A)) - discrete.A, discrete.B @ u)
