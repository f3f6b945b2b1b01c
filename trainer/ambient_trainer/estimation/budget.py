"""A search ends by itself, when its budget is spent, or when it is cancelled: never by an exception raised on itself.

Who cancels holds a :class:`CancelToken`; who searches asks it between evaluations and returns the best so far.
"""

from __future__ import annotations

from dataclasses import dataclass, field


class Cancelled(Exception):
    """Raised where cancelled work has no result that is of use: nothing was searched to the end."""


class CancelToken:
    """Asks whatever holds it to stop soon.

    Attributes
    ----------
    cancelled : bool
        Whether :meth:`cancel` was called.

    Examples
    --------
    >>> token = CancelToken()
    >>> token.cancel()
    >>> token.cancelled
    True
    """

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
    """How much a search may spend.

    Parameters
    ----------
    evaluations : int, optional
        Most evaluations over all starts; None is no limit beyond that of each descent.
    cancel : CancelToken
        Ends the search after the evaluation under way.
    """

    evaluations: int | None = None
    cancel: CancelToken = field(default_factory=CancelToken)

    def spent(self, evaluations: int) -> bool:
        """Whether to stop after so many evaluations."""
        return self.cancel.cancelled or (self.evaluations is not None and evaluations >= self.evaluations)
