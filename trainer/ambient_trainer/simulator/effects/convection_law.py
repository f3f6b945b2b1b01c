"""The loss is not proportional to the difference: a draught sets in with it."""

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.additions import Added, Term
from ambient_trainer.simulator.chamber import coloured
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran

_LEAST_DIFFERENCE_K = 1.0


class ConvectionLaw(Effect):
    """A draught on surfaces."""

    rank = 3
    meaning = "loss at 15 K by a draught, in the convective loss there"
    typical = 2.2
    at, everywhere, since_ever = "surfaces", True, True

    def added(self, acting: Acting, name: str) -> Added:
        """The draught, a little unsteady."""
        where = acting.device.pattern(dict.fromkeys(acting.covered, acting.hidden.amount))
        unsteady = 1.0 + 0.05 * coloured(len(acting.time_s), acting.period_s, 60.0, acting.random())
        return Added((Term("draught", acting.share() * unsteady, where),))

    def magnitude(self, ran: Ran) -> Figure:
        """The exponents by a regression over all affected nodes, each with a factor of its own, weighted by losses."""
        difference = (ran.driven.nodes_degC[:, ran.places] - ran.driven.run.air_degC[:, None])[ran.there]
        with_it, without = (loss[ran.there] for loss in ran.losses())
        far = (np.abs(difference) > _LEAST_DIFFERENCE_K) & (with_it * without > 0.0)
        if not far.any():
            return 0.0, "1", {}
        exponents = [_exponent(difference, loss, far, without) for loss in (with_it, without)]
        bends = [_curvature(difference, loss) for loss in (with_it, without)]
        others = {
            "exponent_with": (exponents[0] - 1.0, "1"),
            "exponent_without": (exponents[1] - 1.0, "1"),
            "curvature_with": (bends[0], "1/K"),
            "curvature_without": (bends[1], "1/K"),
        }
        return exponents[0] - exponents[1], "1", others


def _exponent(difference: Array, loss: Array, far: NDArray[np.bool_], weight: Array) -> float:
    """Of |loss| ~ |difference|^e, shape (n, nodes) each, where ``far``; a factor a node is free."""
    weight = np.where(far, weight**2, 0.0)
    x, y = (np.log(np.where(far, np.abs(each), 1.0)) for each in (difference, loss))
    total = np.maximum(weight.sum(axis=0), 1e-300)
    x, y = x - (weight * x).sum(axis=0) / total, y - (weight * y).sum(axis=0) / total
    return float((weight * x * y).sum() / (weight * x * x).sum())


def _curvature(difference: Array, loss: Array) -> float:
    """b of loss ~ a (difference + b difference |difference|), with an a for each node, shape (n, nodes) each."""
    sums = np.zeros(2)
    for one, lost in zip(difference.T, loss.T):
        (linear, bent), *_ = np.linalg.lstsq(np.column_stack([one, one * np.abs(one)]), lost, rcond=None)
        sums += np.array([linear * bent, linear**2]) * (one**4).sum()
    return float(sums[0] / sums[1])


EFFECT = ConvectionLaw()
