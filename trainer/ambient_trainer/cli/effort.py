"""Stands in :mod:`.options`; goes when nothing imports it from here."""

from ambient_trainer.cli.options import effort_options, jobs_option

__all__ = ["effort_options", "jobs_option"]
