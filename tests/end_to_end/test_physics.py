"""What of the observer's circuit makes it good on the chamber log: it is fitted again without one thing at a time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from ambient_trainer.data.grid import segments
from ambient_trainer.data.trace import load_trace
from ambient_trainer.estimation.search import search
from ambient_trainer.estimators.library.circuit_observer import RandomWalkAmbient, walk_of
from ambient_trainer.lti.response import noise_gain, response_degC

MAP = Path(__file__).parents[1] / "data" / "measured" / "thermal-shock-chamber.map.yaml"
BLIND_S, NONE = 1e7, 1e-9


class Chamber:
    """The log in two parts, and what a circuit leaves of the second one after a fit to the first.

    ``late_samples`` is how much later than logged the reference is taken to be.
    """

    def __init__(self, path, late_samples=0):
        whole = load_trace(str(path))
        moved = np.full_like(whole.reference, np.nan)
        moved[1:-1] = np.roll(whole.reference, late_samples)[1:-1]
        whole = replace(whole, columns={**whole.columns, "ambient_degC": moved})
        split_s = round(0.6 * whole.time_s[-1], 3)
        self.columns = [name for name in whole.columns if name.startswith("ch")]
        (self.whole,) = segments(whole, self.columns, ("ambient_degC",))
        self.training = segments(whole.cut(None, split_s), self.columns, ("ambient_degC",))

    def left_degC(self, pinned):
        """Held-out RMSE and noise gain where the unknowns that begin with a key of ``pinned`` are held at its value."""
        circuit = RandomWalkAmbient(self.columns, walk_of(self.training), self.training)
        bounds = [circuit.search.initial.copy(), circuit.search.low.copy(), circuit.search.high.copy()]
        for index, name in enumerate(circuit.names):
            for start, value in pinned.items():
                if name.startswith(start):
                    for each in bounds:
                        each[index] = np.log(value)
        initial, low, high = bounds
        circuit.search = replace(circuit.search, initial=initial, low=low, high=high)
        with threadpool_limits(1):
            best = search(circuit, 1, 0).best
        found = circuit.filter(best.theta)
        estimate = response_degC(found, "first-order", self.whole.inputs, self.whole.period_s)
        error = self.whole.outputs[0] - estimate - best.beta[0]
        taught = self.training[0].inputs.shape[1]
        return float(np.sqrt(np.nanmean(error[taught:] ** 2))), noise_gain(found, self.whole.period_s)


@pytest.mark.slow
def test_what_the_circuit_is_worth_without_one_thing_at_a_time(process, chamber_log, tmp_path):
    trace = tmp_path / "chamber.csv"
    process("ambient_trainer", "import", chamber_log, "--format", "benchlink", "--map", MAP, "-o", trace)
    chamber = Chamber(trace)
    nodes = [name.removesuffix("_degC") for name in chamber.columns]
    cases = {
        "the whole circuit": {},
        "without heat between the nodes": {"g_": NONE},
        "without heat that nobody logs": {"q_": NONE},
        **{
            f"of the nodes only {node} sees the ambient": {f"tau_{other}": BLIND_S for other in nodes if other != node}
            for node in nodes
        },
    }
    left = {}
    for name, pinned in cases.items():
        left[name], gain = chamber.left_degC(pinned)
        print(f"{name}: held out {left[name]:.2f} degC, noise gain {gain:.1f}")
    for late in (-1, 1):
        name = f"with the reference moved by {10 * late} s"
        left[name], gain = Chamber(trace, late).left_degC({})
        print(f"{name}: held out {left[name]:.2f} degC, noise gain {gain:.1f}")
    whole = left.pop("the whole circuit")
    assert whole < 0.75
    assert min(left.values()) > 1.1 * whole
    assert np.median([each for name, each in left.items() if "only" in name]) > 3 * whole
