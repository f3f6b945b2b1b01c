"""The thesis's equations exactly as printed, for the models where an erratum changes them.

States are flash, battery, usb; parameters go by the names of the circuit files. Nothing here is fitted: a printed
structure is shown with the printed parameters.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ambient_trainer.lti import StateSpace

Values = Mapping[str, float]


@dataclass(frozen=True)
class Printed:
    """A model as printed: how its parameters make a state space, over which trace columns, and what is wrong in it."""

    system: Callable[[Values], StateSpace]
    inputs: tuple[str, ...]
    about: str


def rise_system(p: Values, source: str) -> StateSpace:
    """Equations 4.8, 4.9, 4.11, 4.12 (4.20 to 4.23): row 2 of B with the sign of erratum 1."""
    Cf, Cb, Cu = p["C_flash"], p["C_battery"], p["C_usb"]
    Rf, Rb, Ru = p["R_flash_ambient"], p["R_battery_ambient"], p["R_usb_ambient"]
    Rsf, Rsb, Rbu = p[f"R_{source}_flash"], p[f"R_{source}_battery"], p["R_battery_usb"]
    G = np.array([1 / Rf, 1 / Rb, 1 / Ru])
    return StateSpace(
        A=np.diag([-1 / (Cf * Rf), -1 / (Cb * Rb), -1 / (Cu * Ru)]),
        B=np.array(
            [
                [-1 / (Rsf * Cf), 0, 0, 1 / (Rsf * Cf)],
                [0, (1 / Rbu - 1 / Rsb) / Cb, -1 / (Rbu * Cb), 1 / (Rsb * Cb)],
                [0, 1 / (Rbu * Cu), -1 / (Rbu * Cu), 0],
            ]
        ),
        C=-G[None] / G.sum(),
        D=np.array([[p["w1"], p["w2"], p["w3"], 0]]),
        offset=np.zeros(1),
    )


def free_cd_system(p: Values) -> StateSpace:
    """Equations 4.20, 4.21, 4.29 and 4.30: the same B."""
    weights = np.array([[p[f"w{number}"] for number in range(1, 8)]])
    return replace(rise_system(p, "display"), C=weights[:, :3], D=weights[:, 3:])


def single_input_system(p: Values, source: str, exchange: float) -> StateSpace:
    """Equations 4.14 to 4.17 (4.25 to 4.28) with element (2, 3) of A at ``exchange``; C in the order of erratum 3."""
    Cf, Cb, Cu = p["C_flash"], p["C_battery"], p["C_usb"]
    Rsf, Rsb, Rbu = p[f"R_{source}_flash"], p[f"R_{source}_battery"], p["R_battery_usb"]
    G = np.array([1 / p["R_flash_ambient"], 1 / p["R_usb_ambient"], 1 / p["R_battery_ambient"]])
    return StateSpace(
        A=np.array(
            [
                [-1 / (Rsf * Cf), 0, 0],
                [0, (-1 / Rsb + 1 / Rbu) / Cb, exchange],
                [0, 1 / (Rbu * Cu), -1 / (Rbu * Cu)],
            ]
        ),
        B=np.array([[1 / (Rsf * Cf)], [1 / (Rsb * Cb)], [0]]),
        C=G[None] / G.sum(),
        D=np.zeros((1, 1)),
        offset=np.zeros(1),
    )


def combined_system(p: Values) -> StateSpace:
    """Equation 4.34: c0 with usb, c1 with battery, c2 with flash."""
    D = np.array([[p["c0"], p["c1"], p["c2"]]])
    return StateSpace(np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((1, 0)), D, np.array([p["m"]]))


_NODES = ("flash_degC", "battery_degC", "usb_degC")

PRINTED: Mapping[str, Printed] = {
    "model1_ss": Printed(
        lambda p: rise_system(p, "soc"), (*_NODES, "soc_degC"), "equation 4.9 with the sign of erratum 1"
    ),
    "model1_ss_single_input": Printed(
        lambda p: single_input_system(p, "soc", -1 / (p["R_battery_usb"] * p["C_battery"])),
        ("soc_degC",),
        "equations 4.14 and 4.16 with the sign and the order of errata 1 and 3",
    ),
    "model2_ss": Printed(
        lambda p: rise_system(p, "display"),
        (*_NODES, "display_degC"),
        "equation 4.21 and table 4.4 with the sign of erratum 1 and the w1 of erratum 6",
    ),
    "model2_ss_single_input": Printed(
        lambda p: single_input_system(p, "display", -1 / p["R_battery_usb"]),
        ("display_degC",),
        "equations 4.25 and 4.27 with the sign, the missing capacitance and the order of errata 1, 2 and 3",
    ),
    "model2_ss_free_cd": Printed(free_cd_system, (*_NODES, "display_degC"), "equation 4.21 with the sign of erratum 1"),
    "linear_combined": Printed(
        combined_system, ("usb_degC", "battery_degC", "flash_degC"), "equation 4.34 in the order of erratum 5"
    ),
}
"""By model; the others are printed as they are meant."""
