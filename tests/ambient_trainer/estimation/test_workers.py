"""Ctrl-C stops worker processes, also while they start, without a word of theirs."""

import os
import signal
import subprocess
import sys
import time

import pytest

PROGRAM = """
import time
from joblib import delayed
from ambient_trainer.estimation.workers import results, workers
print("begins", flush=True)
try:
    with workers(2) as processes:
        for _ in results(processes, [delayed(time.sleep)(0.5) for _ in range(100)]):
            pass
except KeyboardInterrupt:
    print("stopped")
"""


@pytest.mark.parametrize("after_s", [0.3, 0.6])
def test_ctrl_c_while_workers_start_prints_nothing_of_theirs(after_s):
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    with subprocess.Popen([sys.executable, "-c", PROGRAM], **options) as process:
        try:
            assert process.stdout.readline() == "begins\n"
            time.sleep(after_s)
            os.killpg(process.pid, signal.SIGINT)
            assert process.communicate(timeout=30) == ("stopped\n", "")
        finally:
            process.kill()
