"""The user's circuit with what a diagnosis added to its model, as far as a circuit can hold it.

It keeps its own form where the result is valid in it; else it becomes its forward form: ambient and drives in, sensors
out. Every value starts where the diagnosis found it, to be fitted again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ambient_model.faults import Refused
from ambient_trainer.circuits.addition import with_heat_of, with_values
from ambient_trainer.circuits.circuit import AMBIENT, Circuit
from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.circuits.write import write_circuit
from ambient_trainer.diagnosis.causes import kind_of
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.model import Effect, Model


@dataclass(frozen=True)
class Extension:
    """A circuit with what was found, None where it can hold none of that; and a sentence for each thing left out."""

    circuit: Circuit | None
    left_out: tuple[str, ...]


def extended_circuit(circuit: Circuit, model: Model) -> Extension:
    """``circuit`` with the effects of ``model``, which has it read forward."""
    held = [effect for effect in model.effects if _why_not(effect) is None]
    left_out = tuple(
        f"A circuit cannot hold {_said(effect)}: {why}."
        for effect in model.effects
        if (why := _why_not(effect)) is not None
    )
    if not held:
        return Extension(None, left_out)
    values = model.plant.values
    try:
        return Extension(_with(circuit, values, held), left_out)
    except Refused:
        pass
    lost = (_NO_ESTIMATE,) if any(output.name == AMBIENT for output in circuit.outputs) else ()
    try:
        return Extension(_with(forward(circuit), values, held), (*left_out, *lost))
    except Refused as refused:
        faults = (f"The circuit with what was found is none: {each}." for each in refused.faults)
        return Extension(None, (*left_out, *faults))


_NO_ESTIMATE = (
    f"The estimate of the {AMBIENT}: in the form of this circuit every node has a sensor, and one that was found has"
    " none; the extended circuit simulates the sensors instead, and is none for a device."
)


def _with(before: Circuit, values: Mapping[str, float], held: Sequence[Effect]) -> Circuit:
    """``before`` at ``values`` with effects that it can hold, as its file would be read; raises :class:`Refused`."""
    circuit = with_values(before, values)
    for effect in held:
        assert effect.candidate.extend is not None
        circuit = effect.candidate.extend(circuit, effect.values)
    circuit = with_heat_of(circuit, before)
    causes = ", ".join(str(effect.candidate.cause) for effect in held)
    name = circuit.name if circuit.name.endswith(_SUFFIX) else circuit.name + _SUFFIX
    named = replace(circuit, name=name, about=f"{circuit.about}; with {causes}")
    return parse_circuit(write_circuit(named), name)


_SUFFIX = "_extended"


def _said(effect: Effect) -> str:
    cause = str(effect.candidate.cause)
    return f"{cause}, as in the known-good records" if effect.known else cause


def _why_not(effect: Effect) -> str | None:
    """Why a circuit cannot hold ``effect``; None where it can."""
    if effect.candidate.extend is None:
        return kind_of(effect.candidate.cause).not_in_circuit(effect.candidate.cause)
    if effect.onset_s is not None or effect.end_s is not None:
        return "it acts for a part of the time, and a circuit is always the same"
    return None
