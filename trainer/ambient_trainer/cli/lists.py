"""Stands in :mod:`.options`; goes when nothing imports it from here."""

from ambient_trainer.cli.options import whole_numbers

__all__ = ["whole_numbers"]
