"""Property tests draw the same examples every time, and are never timed: a loaded machine is no fault."""

from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None, database=None)
settings.load_profile("same")
