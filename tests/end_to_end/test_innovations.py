"""Why observers are taught by their error of the ambient: what the likelihood of the innovations leaves of it instead.

The steady-state Kalman filter of the circuit, sampled at the log's period, is fitted to the chamber's first 60 % by
maximum likelihood of its innovations, from the place from which the prediction-error search starts; the last 40 % is
scored without the reference.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from ambient_trainer.data.grid import segments
from ambient_trainer.data.trace import load_trace
from ambient_trainer.estimators.kalman.observer_structure import prior_theta, walk_of
from ambient_trainer.estimators.kalman.random_walk import RandomWalkAmbient
from ambient_trainer.lti.response import states

MAP = Path(__file__).parents[1] / "data" / "measured" / "thermal-shock-chamber.map.yaml"
REFERENCE_NOISE_DEGC = 0.1
RUN_IN = 30


class Sampled:
    """The circuit's filter at the log's period; its unknowns are theta and the logarithm of the ambient's walk."""

    def __init__(self, path):
        whole = load_trace(str(path))
        self.columns = [name for name in whole.columns if name.startswith("ch")]
        split_s = round(0.6 * whole.time_s[-1], 3)
        (self.whole,) = segments(whole, self.columns, ("ambient_degC",))
        training = segments(whole.cut(None, split_s), self.columns, ("ambient_degC",))
        self.taught = training[0].inputs.shape[1]
        self.period_s = self.whole.period_s
        self.circuit = RandomWalkAmbient(self.columns, walk_of(training))
        self.start = np.append(prior_theta(self.circuit, training), np.log(self.circuit.walk))

    def filter(self, unknowns, noise):
        """Ad, H, K and the innovations' covariance, the last rows of H being of the reference where ``noise`` is."""
        self.circuit.walk = np.exp(unknowns[-1])
        A, Q, variance = self.circuit.process(unknowns[:-1])
        n = len(A)
        found = expm(np.block([[-A, Q], [np.zeros((n, n)), A.T]]) * self.period_s)
        step = found[n:, n:].T
        Q = step @ found[:n, n:]
        H = np.eye(n - 1 + len(noise), n)
        R = np.diag([*variance / self.period_s, *noise])
        P = solve_discrete_are(step.T, H.T, (Q + Q.T) / 2, R)
        S = H @ P @ H.T + R
        return step, H, P @ H.T @ np.linalg.inv(S), S

    def minus_log_likelihood(self, unknowns, noise):
        try:
            step, H, K, S = self.filter(unknowns, noise)
        except np.linalg.LinAlgError:
            return 1e3
        z = np.vstack([self.whole.inputs, self.whole.outputs])[: len(H), : self.taught]
        z[:, np.isnan(z[-1])] = z[:, np.flatnonzero(np.isnan(z[-1])) - 1]
        z = z - z[:, :1]
        innovations = (z - H @ run(step - step @ K @ H, step @ K @ z))[:, RUN_IN:]
        squares = np.mean(np.sum(innovations * np.linalg.solve(S, innovations), axis=0))
        value = (np.linalg.slogdet(S)[1] + squares) / 2
        return value if np.isfinite(value) else 1e3

    def held_out_rmse_degC(self, unknowns):
        """Of the sensors alone, less the mean error of training."""
        step, H, K, _ = self.filter(unknowns, [])
        z = self.whole.inputs - self.whole.inputs[:, :1]
        estimate = (run(step - K @ H @ step, (step - K @ H @ step) @ K @ z) + K @ z)[-1]
        error = self.whole.outputs[0] - estimate
        return float(np.sqrt(np.nanmean((error - np.nanmean(error[: self.taught]))[self.taught :] ** 2)))


def run(A, drive):
    return states(A, drive, np.zeros(len(A)))


@pytest.mark.slow
def test_the_likelihood_of_innovations_knows_no_ambient(process, chamber_log, tmp_path):
    trace = tmp_path / "chamber.csv"
    process("ambient_trainer", "import", chamber_log, "--format", "benchlink", "--map", MAP, "-o", trace)
    sampled, left = Sampled(trace), {}
    at_start = sampled.held_out_rmse_degC(sampled.start)
    with threadpool_limits(1):
        for name, noise in (("sensors alone", []), ("with the reference", [REFERENCE_NOISE_DEGC**2])):
            found = minimize(
                sampled.minus_log_likelihood,
                sampled.start,
                args=(noise,),
                method="L-BFGS-B",
                bounds=[(each - 8, each + 8) for each in sampled.start],
                options={"maxfun": 6000},
            )
            assert found.fun < sampled.minus_log_likelihood(sampled.start, noise)
            left[name] = sampled.held_out_rmse_degC(found.x)
            print(
                f"likelihood, {name}: {found.fun:.2f} a sample, held out {left[name]:.2f} degC (start {at_start:.2f})"
            )
    assert left["sensors alone"] > at_start
    # the prediction-error fit leaves 0.70: see test_measured.py
    assert left["with the reference"] > 2.0
