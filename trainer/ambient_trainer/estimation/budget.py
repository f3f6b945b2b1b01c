"""A search ends by itself, when its budget is spent, or when it is cancelled: never by an exception raised on itself.

Who cancels holds a :class:`CancelToken`; who searches asks it between evaluations and returns the best so far.
"""

from dataclasses import dataclass, field


class Cancelled(Exception):
    """Raised where cancelled work has no result that is of use: nothing was searched to the end."""


class CancelToken:
    """Asks whatever holds it to stop soon; ``cancelled`` says whether :meth:`cancel` was called."""

    def __init__(self) -> None:
        self.cancelled = False

    def cancel(self) -> None:
        """Ask to stop; safe in a signal handler."""
        self.cancelled = True

    def check(self) -> None:
        """Raise :class:`Cancelled` where this was cancelled: for work whose part is of no use."""
        if self.cancelled:
            raise Cancelled


@dataclass(frozen=True)
class Budget:
    """How much a search may spend: so many ``evaluations`` over all starts, or without a limit beyond each descent's.

    ``cancel`` ends it after the evaluation under way.
    """

    evaluations: int | None = None
    cancel: CancelToken = field(default_factory=CancelToken)

    def spent(self, evaluations: int) -> bool:
        """Whether to stop after so many evaluations."""
        return self.cancel.cancelled or (self.evaluations is not None and evaluations >= self.evaluations)
