"""Stands in :mod:`.options`; goes when nothing imports it from here."""

from ambient_trainer.cli.options import Finite, FiniteRange, sampling_option

__all__ = ["Finite", "FiniteRange", "sampling_option"]
