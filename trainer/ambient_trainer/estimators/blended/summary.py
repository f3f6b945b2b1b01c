"""What an observer's fit has to say beside what every fit says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambient_model.model import Spread
from ambient_trainer.estimators.blended.bank import Bank
from ambient_trainer.estimators.blended.forward_fit import ForwardFit
from ambient_trainer.estimators.blended.recipe import Recipe
from ambient_trainer.estimators.blended.trained_filter import TaughtFilter

_LEVEL = 90
_SHARES_PERCENT = (10, 50, 90)


def figures(
    recipe: Recipe,
    bank: Bank,
    circuit: ForwardFit,
    spread: Spread,
    sigmas_degC: NDArray[np.float64],
    fallback_rmses_degC: Mapping[str, float],
) -> dict[str, Any]:
    """What the model file and ``fit --json`` say of the observer; ``sigmas_degC`` are those of the training samples."""
    reach = np.percentile(sigmas_degC, _SHARES_PERCENT) * spread.quantiles[_LEVEL][1]
    return {
        "main": _filter(bank.main),
        "guard": _filter(bank.guard),
        "threshold_degC": bank.threshold_degC,
        "half_width_90_degC": dict(zip(map(str, _SHARES_PERCENT), reach.tolist())),
        "fallbacks": {
            name: {**_filter(each), "rmse_degC": fallback_rmses_degC[name]} for name, each in bank.fallbacks.items()
        },
        "forward_circuit": {
            "name": recipe.circuit,
            "values": circuit.values,
            "misfit_degC": circuit.misfit_degC,
            "evaluations": circuit.evaluations,
        },
        # what is not fitted; see the observer file for where each number comes from
        "declared": recipe.model_dump(mode="json", exclude={"format", "version", "name", "about"}),
    }


def notes(told: Mapping[str, Any]) -> tuple[str, ...]:
    """The figures as lines for the terminal."""
    main, guard, circuit = told["main"], told["guard"], told["forward_circuit"]
    half = told["half_width_90_degC"]
    misfit = ", ".join(f"{name} {each:.2f}" for name, each in circuit["misfit_degC"].items())
    fallbacks = ", ".join(f"{name} {each['rmse_degC']:.2f}" for name, each in told["fallbacks"].items()) or "none"
    return (
        f"Noise gain: {main['noise_gain']:.2f}, the guard's {guard['noise_gain']:.2f} (output per unit of white noise "
        f"in every sensor, at {main['period_s']:g} s).",
        f"Time constants: {_times(main['time_constants_s'])}; the guard's {_times(guard['time_constants_s'])}.",
        f"Guard: it has a say from {told['threshold_degC']:.2f} degC of difference on, the last word from twice that.",
        f"Half of the 90 % interval: {half['50']:.2f} degC over the median training sample, {half['10']:.2f} when "
        f"quiet (10 %), {half['90']:.2f} in transients (90 %).",
        f"Without a sensor, RMSE on the training samples: {fallbacks}.",
        f"Forward circuit {circuit['name']} misses the sensors by (RMS) {misfit} degC.",
        f"Declared, not fitted: heat that nobody logs ({', '.join(told['declared']['unlogged']['patterns'])}), "
        "made-up weather and work, weights.",
    )


def _filter(each: TaughtFilter) -> dict[str, Any]:
    return {
        "noise_gain": each.noise_gain,
        "period_s": each.period_s,
        "time_constants_s": [[tau.real, tau.imag] for tau in each.time_constants_s],
        "gains_at_rest": each.gains_at_rest,
        "converged": each.found.converged,
    }


def _times(constants_s: Sequence[Sequence[float]]) -> str:
    """Time constants as text, a damped pair as one."""
    shown = [f"{real:.0f}" if not imaginary else f"{real:.0f} ± {imaginary:.0f}j" for real, imaginary in constants_s]
    return f"{', '.join(each for each, (_, imaginary) in zip(shown, constants_s) if imaginary >= 0)} s"
