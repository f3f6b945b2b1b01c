"""Stands in :mod:`.output`; goes when nothing imports it from here."""

from ambient_trainer.cli.output import check_outputs

__all__ = ["check_outputs"]
