"""What a recipe's fit reports beside what every fit reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambient_model.model import ErrorVariance
from ambient_trainer.estimators.blended.filters import Filters
from ambient_trainer.estimators.blended.forward_fit import ForwardFit
from ambient_trainer.estimators.blended.recipe import Recipe
from ambient_trainer.estimators.blended.trained_filter import TrainedFilter
from ambient_trainer.estimators.observer import fallback_notes, half_width_note

_LEVEL = 90
_SHARES_PERCENT = (10, 50, 90)


def details(
    recipe: Recipe,
    filters: Filters,
    circuit: ForwardFit,
    variance: ErrorVariance,
    sigmas_degC: NDArray[np.float64],
    fallback_rmses_degC: Mapping[str, float],
) -> dict[str, Any]:
    """For the model file and ``fit --json``; ``sigmas_degC`` are the expected errors of the training samples."""
    reach = np.percentile(sigmas_degC, _SHARES_PERCENT) * variance.quantiles[_LEVEL][1]
    return {
        "main": _filter(filters.main),
        "guard": _filter(filters.secondary),
        "threshold_degC": filters.threshold_degC,
        "half_width_90_degC": dict(zip(map(str, _SHARES_PERCENT), reach.tolist())),
        "fallbacks": {
            name: {**_filter(each), "rmse_degC": fallback_rmses_degC[name]} for name, each in filters.fallbacks.items()
        },
        "forward_circuit": {
            "name": recipe.circuit,
            "values": circuit.values,
            "misfit_degC": circuit.misfit_degC,
            "evaluations": circuit.evaluations,
        },
        # what is not fitted; the recipe names where each number comes from
        "declared": recipe.model_dump(mode="json", exclude={"format", "version", "name", "about"}),
    }


def notes(found: Mapping[str, Any]) -> tuple[str, ...]:
    """The same as lines for the terminal."""
    main, secondary, circuit = found["main"], found["guard"], found["forward_circuit"]
    misfit = ", ".join(f"{name} {each:.2f}" for name, each in circuit["misfit_degC"].items())
    rmses = {name: each["rmse_degC"] for name, each in found["fallbacks"].items()}
    return (
        f"Noise gain: {main['noise_gain']:.2f}, the secondary's {secondary['noise_gain']:.2f} (output per unit of "
        f"white noise in every sensor, at {main['period_s']:g} s).",
        f"Time constants: {_times(main['time_constants_s'])}; the secondary's {_times(secondary['time_constants_s'])}.",
        f"Secondary: blended in from {found['threshold_degC']:.2f} degC of difference on, alone from twice it.",
        half_width_note(found["half_width_90_degC"]),
        *fallback_notes(rmses),
        f"Forward circuit {circuit['name']} misses the sensors by (RMS) {misfit} degC.",
        f"Declared, not fitted: unmeasured heat ({', '.join(found['declared']['unlogged']['patterns'])}), "
        "synthetic ambient and work, weights.",
    )


def _filter(each: TrainedFilter) -> dict[str, Any]:
    return {
        "noise_gain": each.noise_gain,
        "period_s": each.period_s,
        "time_constants_s": [[tau.real, tau.imag] for tau in each.time_constants_s],
        "gains_at_rest": each.dc_gains,
        "converged": each.found.converged,
    }


def _times(constants_s: Sequence[Sequence[float]]) -> str:
    """Time constants as text, a damped pair as one."""
    shown = [f"{real:.0f}" if not imaginary else f"{real:.0f} ± {imaginary:.0f}j" for real, imaginary in constants_s]
    return f"{', '.join(each for each, (_, imaginary) in zip(shown, constants_s) if imaginary >= 0)} s"
