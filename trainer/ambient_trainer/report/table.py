"""Where :class:`Table` stood before there were reports; goes when nothing imports it from here."""

from ambient_trainer.report.structure import Table
from ambient_trainer.report.terminal import for_terminal

__all__ = ["Table", "for_terminal"]
