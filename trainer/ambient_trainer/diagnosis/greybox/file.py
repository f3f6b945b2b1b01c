"""Conversion of mechanisms to a circuit file and back: nodes, edges and sources, else under ``mechanisms``."""

from dataclasses import fields, replace
from functools import cache

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.circuits.addition import with_values
from ambient_trainer.circuits.circuit import Addition, Circuit
from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox import mechanisms
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism, Number
from ambient_trainer.diagnosis.record import Record

_OWN = {each.name for each in fields(Mechanism)}
_OF_A_NUMBER = ("unit", "value", "log", "scale")
_SUFFIX = "_extended"


@cache
def kinds() -> dict[str, type[Mechanism]]:
    """Every kind of mechanism by the name of its class."""
    modules = [plugin(mechanisms.__name__, name) for name in plugin_names(mechanisms.__name__)]
    classes = (each for module in modules for each in vars(module).values() if isinstance(each, type))
    return {each.__name__: each for each in classes if issubclass(each, Mechanism) and each.cause}


def extended_circuit(circuit: Circuit, model: GreyBox) -> Circuit:
    """``circuit`` with the values and the mechanisms of ``model``, in forward form: it simulates the same.

    Where nodes, edges and sources between the nodes it has say it all, the circuit keeps its own form.
    """
    values = {each.name: each.value for each in model.own}
    kept, result = _added(with_values(circuit, values), model)
    if kept or len(result.states) > len(circuit.states):
        kept, result = _added(with_values(forward(circuit), values), model)
    about = f"{circuit.about}; with {', '.join(map(str, model.mechanisms))}".removeprefix("; ")
    name = result.name if result.name.endswith(_SUFFIX) else result.name + _SUFFIX
    return replace(result, name=name, about=about, mechanisms=tuple(kept))


def _added(circuit: Circuit, model: GreyBox) -> tuple[list[Addition], Circuit]:
    """What nodes, edges and sources cannot say, and the circuit with what they can."""
    result = replace(circuit, mechanisms=())
    kept: list[Addition] = []
    for each in model.mechanisms:
        native = each.native(result) if each.permanent else None
        if native is None:
            kept.append(addition_of(each))
        else:
            result = native
    return kept, result


def addition_of(mechanism: Mechanism) -> Addition:
    """A mechanism as a circuit holds it."""
    given = {each.name: getattr(mechanism, each.name) for each in fields(mechanism) if each.name not in _OWN}
    settings = {name: list(value) if isinstance(value, tuple) else value for name, value in given.items()}
    numbers = {each.name: {name: getattr(each, name) for name in _OF_A_NUMBER} for each in mechanism.numbers}
    driver = None if mechanism.driver is None else mechanism.driver.text
    kind, window = type(mechanism).__name__, (mechanism.onset_s, mechanism.end_s)
    return Addition(kind, mechanism.places, driver, *window, numbers, settings)


def mechanism_of(addition: Addition, source: str) -> Mechanism:
    """A mechanism from a circuit; raises :class:`Refused` where its kind or its settings are unknown."""
    kind = kinds().get(addition.kind)
    if kind is None:
        raise refuse(source, "mechanisms", f"no kind is called {addition.kind!r}", f"take one of {', '.join(kinds())}")
    known = {each.name for each in fields(kind)} - _OWN
    if unknown := set(addition.settings) - known:
        raise refuse(source, f"mechanisms.{addition.kind}", f"unknown setting {sorted(unknown)[0]!r}", "remove it")
    settings = {name: tuple(value) if isinstance(value, list) else value for name, value in addition.settings.items()}
    numbers = tuple(Number(name, **given) for name, given in addition.numbers.items())
    driver = None if addition.by is None else Expression(addition.by)
    return kind(addition.at, numbers, driver, addition.from_s, addition.to_s, **settings)


def greybox_of(circuit: Circuit) -> GreyBox:
    """The model of a circuit in forward form, with the mechanisms in it."""
    model = GreyBox.of(circuit)
    for index, each in enumerate(circuit.mechanisms):
        model = model.with_mechanism(mechanism_of(each, circuit.name))
        _check(model, f"mechanisms[{index}]")
    return model


def _check(model: GreyBox, place: str) -> None:
    """Refuse a last mechanism that cannot act on the circuit: it is tried on two samples of zeros."""
    last = model.mechanisms[-1]
    names = [f"{each.removeprefix('-')}_degC" for each in last.places[0].partition("-")[2:]] if last.places else []
    names += [name for each in model.mechanisms if each.driver is not None for name in each.driver.columns]
    inputs, sensors = (np.zeros((len(each), 2)) for each in (model.circuit.inputs, model.circuit.outputs))
    signals = dict.fromkeys([*model.circuit.inputs, *names], np.zeros(2))
    record = Record(1.0, np.arange(2.0), inputs, sensors, signals)
    try:
        network = model.network(record, model.z()[None])
        network.simulate(np.zeros((1, len(network.nodes))))
        shape = np.shape(last.probes())
    except (ValueError, IndexError, KeyError, TypeError):
        hint = "name nodes or sensors of the circuit, and every number and setting of its kind"
        raise refuse(model.circuit.name, place, f"{type(last).__name__} cannot act on this circuit", hint) from None
    if shape[-1] != len(last.numbers):
        raise refuse(model.circuit.name, place, f"{len(last.numbers)} numbers", f"{shape[-1]} are needed")
