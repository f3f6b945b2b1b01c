"""What ``run`` holds while it ticks: stand-ins for typing, and no module that only its configuration needs."""

import os
import signal
from pathlib import Path

from ambientd.handover import Child
from refusals import refused

ROOT = Path(__file__).parents[2]
HEAVY = {"argparse", "collections", "contextlib", "enum", "functools", "json", "re", "signal", "socket", "typing"}
HEAVY |= {"ambient_model.codec", "ambientd.cli", "ambientd.config", "yaml"}


def test_a_daemon_that_publishes_a_file_imports_nothing_else(ambientd):
    code = (
        f"import sys; sys.path[:0] = [{str(ROOT / 'daemon')!r}, {str(ROOT / 'shared')!r}]; from ambientd import lean;"
        "lean.install(); import ambientd.handover, ambientd.run, ambientd.publish.file;"
        "lean.restore(); print(*sys.modules)"
    )
    done = ambientd(by=("-I", "-S", "-c", code))
    assert done.stderr == ""
    assert HEAVY & set(done.stdout.split()) == set()


def test_a_child_that_is_killed_is_a_refusal():
    assert "was ended" in str(refused(Child(lambda: os.kill(os.getpid(), 9)).result))


def test_ctrl_c_is_the_parents_to_answer(start):
    script = """
import os, signal, time
from ambientd.handover import Child
def call():
    os.write(1, b"at work\\n")
    time.sleep(1.0)
    return 7
child = Child(call)
signal.signal(signal.SIGINT, lambda number, frame: print("taken"))
os.write(1, b"listening\\n")
print(child.result())
"""
    process = start(by=("-c", script), start_new_session=True)
    assert {process.stdout.readline(), process.stdout.readline()} == {"at work\n", "listening\n"}
    os.killpg(process.pid, signal.SIGINT)
    printed, errors = process.communicate(timeout=30)
    assert (printed.split(), errors, process.returncode) == (["taken", "7"], "", 0)
