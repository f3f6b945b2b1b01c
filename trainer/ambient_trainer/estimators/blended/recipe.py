"""A recipe is a YAML file: it names the forward circuit, unmeasured heat, and the training set of the filters.

It is taken whole or refused with every fault and its place in one message.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.trace import REFERENCE, split_column
from ambient_trainer.circuits import Circuit, circuit_names, load_circuit
from ambient_trainer.data.strict_yaml import Strict, holds, load_yaml, validated

FORMAT = "ambient-observer"
_LIBRARY = Path(__file__).parents[1] / "library"
LOGGED, IDLE, RESIDUAL = "logged", "idle", "residual"
"""The runs of every training set, beside the patterns'."""


_INCREASING = holds(lambda span: span[0] < span[1], "{0[0]:g} is not below {0[1]:g}", "give the lower one first")
_HAS_UNIT = holds(
    lambda column: split_column(column)[1] != "", "{!r:.60} has no unit", "name a trace column, such as soc_power_W"
)
_Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
_Column = Annotated[_Name, _HAS_UNIT]
_Positive = Annotated[float, Field(gt=0, le=1e9)]
_NotNegative = Annotated[float, Field(ge=0, le=1e9)]
_Share = Annotated[float, Field(gt=0, lt=1)]
_Span = Annotated[tuple[float, float], _INCREASING]
_PositiveSpan = Annotated[tuple[_Positive, _Positive], _INCREASING]
_Signals = Annotated[dict[_Column, float], Field(min_length=1)]
_Parts = dict[_Name, _NotNegative]


class _Sensor(Strict):  # a sensor's lag behind its node, and the standard deviation of the circuit's misfit
    lag_s: _Positive
    trust_degC: _Positive


class _Measured(Strict):  # heat of ``watts`` (W per unit of each trace column) that goes into one node
    into: _Name
    watts: _Signals


class _Shared(Strict):  # heat of ``watts`` (W per unit of each trace column) of which each node takes a share
    watts: _Signals
    among: Annotated[dict[_Name, float], Field(min_length=1)]


class _Heat(Strict):  # the measured heat
    measured: _Measured
    shared: _Shared


class Loss(Strict):
    """The law of a surface's loss; see ``forward.py``."""

    rho: _Share
    exponent: Annotated[float, Field(ge=0, le=1)]
    at_rise_K: _Positive
    at_degC: Annotated[float, Field(gt=-273.15, le=1000)]


class _Prior(Strict):  # standard deviations of the unknowns, and how many samples a sensor's log counts as
    capacitance: _Positive
    resistance: _Positive
    lag: _Positive
    share: _Positive
    rho: _Positive
    samples: _Positive


class Work(Strict):
    """The signal, and what of it is more than idling."""

    signal: _Column
    busy_above: float


class _Simulated(Strict):  # how many runs of how many hours
    runs: Annotated[int, Field(ge=1, le=20)]
    hours: Annotated[float, Field(ge=1, le=48)]


class Synthetic(Strict):
    """The ambient and the work of synthetic runs."""

    ambient_degC: _Span
    stay_min: _PositiveSpan
    settling_s: _Positive
    episode_min: _PositiveSpan
    busy: _Share
    idle: _Simulated


class _Pattern(Strict):  # variants of the heat of one use, in W per node; ``alone`` on a device that does nothing else
    watts: Annotated[tuple[Annotated[dict[_Name, _Positive], Field(min_length=1)], ...], Field(min_length=1)]
    alone: bool = False


class Unmeasured(_Simulated):
    """Unmeasured heat: each variant of each pattern is simulated in ``runs`` runs."""

    episode_min: _PositiveSpan
    pause_min: _PositiveSpan
    log_deviation: _NotNegative
    patterns: dict[_Name, _Pattern]


class _Weights(Strict):  # what each part of the training set weighs in each objective
    main: _Parts
    secondary: _Parts
    interval: _Parts


class _SlowPoles(Strict):  # two real poles: initial values and bounds
    time_constants_s: tuple[_Positive, _Positive]
    slowest_s: _Positive
    least_ratio: Annotated[float, Field(gt=1, le=10)]


class _FastPoles(Strict):  # a pair of poles: initial 1/omega and damping, and a bound
    time_s: _Positive
    damping: _Positive
    least_damping: _Positive


class FilterRules(Strict):
    """Penalties on a filter's noise gain and DC gains, and the bounds of its poles."""

    noise: _Positive
    offset_degC: _NotNegative = 0.0
    one_degree: _Positive
    slow: _SlowPoles
    fast: _FastPoles


class _Threshold(Strict):  # ``times`` a quantile of the two filters' distance on the log
    percent: Annotated[float, Field(gt=50, le=100)]
    times: _Positive


class _VarianceLags(Strict):  # time constants of the error variance's terms
    movement_lag_s: _Positive
    secondary_lag_s: _Positive


class Recipe(Strict):
    """A validated recipe."""

    format: Literal["ambient-observer"]
    version: Literal[1]
    name: _Name
    about: str
    circuit: str
    sensors: Annotated[dict[_Name, _Sensor], Field(min_length=2)]
    heat: _Heat
    loss: Loss
    prior: _Prior
    work: Work
    made_up: Synthetic
    unlogged: Unmeasured
    weights: _Weights
    filter: FilterRules
    threshold: _Threshold
    error_variance: _VarianceLags

    @property
    def sensor_columns(self) -> tuple[str, ...]:
        """The trace columns that the estimate is made of, in order."""
        return tuple(f"{name}_degC" for name in self.sensors)

    @property
    def drive_columns(self) -> tuple[str, ...]:
        """The trace columns that training needs beside them, without the reference."""
        return tuple(dict.fromkeys([*self.heat.measured.watts, *self.heat.shared.watts, self.work.signal]))


def recipe_names() -> tuple[str, ...]:
    """The names of the shipped recipes."""
    return tuple(sorted(path.stem for path in _LIBRARY.glob("*.yaml")))


def find_recipe(name_or_path: str) -> tuple[Recipe, Circuit] | None:
    """The shipped recipe of that name, or the one in a YAML file, with its circuit; None where it is none.

    Raises :class:`Refused` with every fault of a file that calls itself one.
    """
    path = str(_LIBRARY / f"{name_or_path}.yaml") if name_or_path in recipe_names() else name_or_path
    data = load_yaml(path) if path.endswith((".yaml", ".yml")) else None
    return read_recipe(data, path) if isinstance(data, dict) and data.get("format") == FORMAT else None


def read_recipe(data: Any, source: str) -> tuple[Recipe, Circuit]:
    """The recipe that ``data`` describes, with its circuit; ``source`` names it in messages."""
    recipe = validated(Recipe, data, source)
    name = recipe.circuit
    if name.endswith((".yaml", ".yml")):
        name = str(Path(source).parent / name)
    elif name not in circuit_names():
        hint = f"take one of {', '.join(circuit_names())}, or a .yaml file beside this one"
        raise refuse(source, "circuit", f"no circuit is called {name!r}", hint)
    circuit = load_circuit(name)
    if faults := [*_faults(recipe, circuit)]:
        raise Refused(source, faults)
    return recipe, circuit


def _faults(recipe: Recipe, circuit: Circuit) -> Iterator[Fault]:
    states = [node.name for node in circuit.states]
    read = [str(node.sensor) for node in circuit.states if node.sensor is not None]
    if circuit.form != "temperature" or [f"{node.sensor}_degC" for node in circuit.measured] != [REFERENCE]:
        hint = "take one of form temperature in which the ambient, with 'sensor: ambient', is all that is prescribed"
        yield Fault("circuit", f"{circuit.name} cannot be simulated from the ambient alone", hint)
    for name in recipe.sensors:
        if name not in read:
            yield Fault(f"sensors.{name}", f"reads no state of {circuit.name}", f"its sensors are {', '.join(read)}")
    named = {f"heat.shared.among.{node}": node for node in recipe.heat.shared.among}
    for name, pattern in recipe.unlogged.patterns.items():
        for index, watts in enumerate(pattern.watts):
            named |= {f"unlogged.patterns.{name}.watts[{index}].{node}": node for node in watts}
    for place, node in {"heat.measured.into": recipe.heat.measured.into, **named}.items():
        if node not in states:
            hint = f"its nodes are {', '.join(states)}"
            yield Fault(place, f"{circuit.name} has no node {node!r} with a capacitance", hint)
    patterns = recipe.unlogged.patterns
    for name in patterns:
        if name in (LOGGED, IDLE, RESIDUAL):
            yield Fault(f"unlogged.patterns.{name}", "is the name of a part of every training set", "rename it")
    for who, weights in recipe.weights.model_dump().items():
        # the residuals of the circuit are no estimate's errors
        known = [LOGGED, IDLE, *([] if who == "interval" else [RESIDUAL]), *patterns]
        for name in weights:
            if name not in known:
                yield Fault(f"weights.{who}.{name}", "is no part of the training set", f"known are {', '.join(known)}")
        if not weights.get(LOGGED):
            yield Fault(f"weights.{who}.{LOGGED}", "is 0", "weigh the log, which was measured, above 0")
