"""Li et al. 2020: a thermal circuit is solved for the ambient by fixed-point iteration.

Given: a thermal circuit, an iteration to a fixed point for the ambient; a mean absolute error of 0.7 degC on a phone
that warms by at most 7 degC under full load.

Filled in: the circuit, which is the outside of the thesis's model 2. A surface, whose temperature lies between the USB
port's and the display's, takes heat from battery, flash and SoC through resistances, has heat of its own, stores some
and loses the rest to the air, by radiation (nearly linear) and natural convection (which grows with the difference to
the power 1.25, laminar air along a plate):

    C dT_s/dt = P + sum_j G_j (T_j - T_s) - G_0 (1 + kappa |y|^0.25) y,     y = T_s - T_amb.

Divided by G_0, with T_s = w T_usb + (1 - w) T_display and Q the heat that arrives and is not stored, over G_0 (in K):

    T_amb = g(T_amb) = T_s - Q / (1 + kappa |T_s - T_amb|^0.25).

The iteration contracts: with z = ln |y| it reads z <- ln |Q| - ln(1 + kappa exp(z / 4)), whose slope lies in (-1/4, 0]
for any z and kappa >= 0. Each step leaves at most a quarter of the distance to the one fixed point, from anywhere, so
no damping is needed; y keeps the sign of Q, and is 0 with it.

dT_s/dt comes from samples of a tenth of a degree, so it is taken behind a first-order lag, s / (1 + tau s). The eight
parameters are those of least squares on the training trace, none negative.

Source: section 1.1 and chapter 5 of the thesis; the paper itself was not at hand.
"""

from dataclasses import astuple, dataclass

import numpy as np
from scipy.optimize import least_squares

from ambient_studies.thesis.related._samples import Related, Samples, lagged, training_samples
from ambient_trainer.data import Array, Trace

SENSORS = ("usb_degC", "display_degC", "battery_degC", "flash_degC", "soc_degC")

_TOLERANCE_K = 1e-9
_MOST_ITERATIONS = 60
_LEAST_SAMPLES = 100
_MOST_SAMPLES = 4000


@dataclass(frozen=True)
class Surface:
    """The circuit's parameters, over the conductance G_0 of the linear loss."""

    usb_share: float
    """w, 0 to 1."""
    battery: float
    """G_battery / G_0, as for flash and SoC."""
    flash: float
    soc: float
    own_heat_K: float
    """P / G_0."""
    storage_s: float
    """C / G_0."""
    convection: float
    """kappa in K^-0.25."""
    lag_s: float
    """tau of the derivative."""

    def ambient_degC(self, time_s: Array, rows: Array) -> Array:
        """The estimate, shape (n,), from the sensors (5, n)."""
        surface, heat = self.balance(time_s, rows)
        return fixed_point(surface, heat, self.convection)

    def balance(self, time_s: Array, rows: Array) -> tuple[Array, Array]:
        """T_s in degC and Q in K, both (n,), from the sensors (5, n)."""
        surface = self.usb_share * rows[0] + (1.0 - self.usb_share) * rows[1]
        slope_K_s = (surface - lagged(time_s, surface, self.lag_s)) / self.lag_s
        arriving = np.array([self.battery, self.flash, self.soc]) @ (rows[2:] - surface)
        return surface, self.own_heat_K + arriving - self.storage_s * slope_K_s


def fixed_point(surface_degC: Array, heat_K: Array, convection: float) -> Array:
    """The ambient in degC, shape (n,), with ambient = surface - heat / (1 + convection |surface - ambient|^0.25).

    NaN for a sample that has not settled to 1e-9 K within 60 steps; with ``convection`` >= 0 all have long before.
    """
    ambient: Array = surface_degC - heat_K
    moving = np.arange(len(ambient))  # each sample stops by itself, so none depends on the others
    for _ in range(_MOST_ITERATIONS):
        surface, before = surface_degC[moving], ambient[moving]
        loss = 1.0 + convection * np.sqrt(np.sqrt(np.abs(surface - before)))
        ambient[moving] = surface - heat_K[moving] / loss
        moving = moving[np.abs(ambient[moving] - before) > _TOLERANCE_K]
        if not len(moving):
            break
    ambient[moving] = np.nan
    return ambient


_START = Surface(0.5, 0.3, 0.1, 0.02, 0.1, 300.0, 0.5, 60.0)
_LOW = Surface(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0)
_HIGH = Surface(1.0, 10.0, 10.0, 10.0, 10.0, 5000.0, 5.0, 600.0)


def train(training: Trace) -> Surface:
    """The circuit of one trace; raises :class:`Refused` where it is too short."""
    samples = training_samples(training, SENSORS, _LEAST_SAMPLES)
    known = np.flatnonzero(~np.isnan(samples.ambient_degC))
    compared = known[:: -(-len(known) // _MOST_SAMPLES)]
    found = least_squares(
        _errors,
        astuple(_START),
        bounds=(astuple(_LOW), astuple(_HIGH)),
        x_scale=astuple(_START),
        args=(samples, compared),
    )
    return Surface(*found.x.tolist())


def _errors(parameters: Array, samples: Samples, compared: Array) -> Array:
    circuit = Surface(*parameters.tolist())
    surface, heat = circuit.balance(samples.time_s, samples.rows)
    return samples.ambient_degC[compared] - fixed_point(surface[compared], heat[compared], circuit.convection)


METHOD = Related(
    "li_fixed_point",
    "Li et al. 2020: a thermal circuit solved for the ambient by fixed-point iteration. Given: that. Filled in: the "
    "circuit (a surface between USB port and display, natural convection) and its fit",
    SENSORS,
    train,
)
