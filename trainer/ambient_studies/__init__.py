"""Studies of the thesis and of the simulated phone; they use the API of ``ambient_trainer``, nothing uses them."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with what is under way, how much of it is done, and of how much."""
