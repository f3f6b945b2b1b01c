"""Tests of a residual: whether it is white noise, and what it depends on where it is not.

The thresholds of the tests for whiteness are the textbook's. An autocorrelated residual exceeds all others by chance:
theirs come from residuals simulated without an effect, with autoregressions drawn from those that the residual leaves
probable. One report in 20 without an effect is meant to have a false alarm: of 100 samples, half white noise and half
with an autocorrelation time of 100 samples, 9 in 100 had one, of 240 such samples 5; of 100 or 200 white samples, or
with an autocorrelation time of 10, at most 2.
"""

from ambient_trainer.diagnosis.residual_tests.all_tests import residual_tests

__all__ = ["residual_tests"]
