"""The thesis's equations exactly as printed, for the models where an erratum changes them: each misprint put back.

A circuit holds a model's equations as corrected, over the states flash, battery and USB port. Nothing here is fitted: a
printed structure is shown with the printed parameters.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

from ambient_studies.thesis.published import published_parameters
from ambient_trainer.circuits import assemble, load_circuit
from ambient_trainer.lti import StateSpace

_ABOUT = {
    "model1_ss": "equation 4.9 with the sign of erratum 1",
    "model1_ss_single_input": "equations 4.14 and 4.16 with the sign and the order of errata 1 and 3",
    "model2_ss": "equation 4.21 and table 4.4 with the sign of erratum 1 and the w1 of erratum 6",
    "model2_ss_single_input": "equations 4.25 and 4.27 with the sign, the missing capacitance and the order of errata "
    "1, 2 and 3",
    "model2_ss_free_cd": "equation 4.21 with the sign of erratum 1",
    "linear_combined": "equation 4.34 in the order of erratum 5",
}
"""By model; the others are printed as they are meant."""


@dataclass(frozen=True)
class Printed:
    """A model as printed: its state space, the trace columns that go into it, and what is wrong in it."""

    system: StateSpace
    inputs: tuple[str, ...]
    about: str


@cache
def printed_models() -> Mapping[str, Printed]:
    """The models that are printed with a misprint, by name."""
    inputs = {model: load_circuit(model).inputs for model in _ABOUT}
    battery, usb, flash = inputs["linear_combined"]
    inputs["linear_combined"] = (usb, battery, flash)  # erratum 5: the coefficients in another order than the sensors
    return {model: Printed(_system(model), inputs[model], about) for model, about in _ABOUT.items()}


def _system(model: str) -> StateSpace:
    circuit, values = load_circuit(model), published_parameters()[model].printed
    meant = assemble(circuit, values).value
    if model == "linear_combined":
        return meant
    A, B, C = meant.A.copy(), meant.B.copy(), meant.C
    # erratum 1: in the battery's row the exchange with the USB port has the other sign
    wrong = assemble(circuit, {**values, "R_battery_usb": -values["R_battery_usb"]}).value
    A[1], B[1] = wrong.A[1], wrong.B[1]
    if model == "model2_ss_single_input":  # erratum 2: a capacitance is missing
        A[1, 2] *= values["C_battery"]
    if model.endswith("single_input"):  # erratum 3: the conductances to the ambient in another order than the states
        C = C[:, [0, 2, 1]]
    return replace(meant, A=A, B=B, C=C)
