"""Tests of a residual: whether it is white noise, and what it depends on where it is not.

The thresholds of the tests for whiteness are the textbook's. An autocorrelated residual exceeds all others by chance:
theirs come from residuals simulated without an effect, with autoregressions drawn from those that the residual leaves
probable. One report in 20 without an effect is meant to have a false alarm: of 60 with 100 white samples 2 had one; of
samples half white noise and half with an autocorrelation time of 100, 1 of 40 with 400 had one, 7 of 60 with 100.
"""

from ambient_trainer.diagnosis.residual_tests.all_tests import residual_memory_s, residual_tests

__all__ = ["residual_memory_s", "residual_tests"]
