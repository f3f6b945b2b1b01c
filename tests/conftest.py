"""Property tests draw the same examples every time, and are never timed: a loaded machine is no fault."""

import signal

from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None, database=None)
settings.load_profile("same")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # tests that run in a shell's background are deaf to Ctrl-C, and so would be every program that they start
    signal.signal(signal.SIGINT, signal.default_int_handler)
