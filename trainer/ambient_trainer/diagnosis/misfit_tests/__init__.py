"""What is wrong with a residual, test by test: is it noise, and where it is not, what does it go along with.

A residual that remembers itself fools every textbook threshold. Here only the tests for whiteness use one, since that
is what they ask; all others get theirs from residuals simulated with the same memory and no effect. That takes a
record of several times the memory: of 240 samples, half white noise and half with a memory of 100 samples, 9 of 30
reports had a false alarm, where 1.5 are meant.
"""

from ambient_trainer.diagnosis.misfit_tests.every import misfit_tests

__all__ = ["misfit_tests"]
