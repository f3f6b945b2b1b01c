"""What is wrong with a residual, test by test: is it noise, and where it is not, what does it go along with.

A residual that remembers itself fools every textbook threshold. Here only the tests for whiteness use one, since that
is what they ask; all others get theirs from residuals simulated without an effect, with memories that the residual
leaves probable. One report in 20 without an effect is meant to have a false alarm: of 100 samples with a memory of as
many beside as much white noise 9 in 100 had one, of 240 such samples 5; of 100 or 200 white samples, or ones with a
memory of 10, at most 2. What a short record leaves open counts as memory, and small effects in it as chance.
"""

from ambient_trainer.diagnosis.residual_tests.all_tests import residual_tests

__all__ = ["residual_tests"]
