"""Ctrl-C ends a fit and keeps the best so far, marked as such."""

import json
import os
import pty
import signal
import subprocess
import sys

from ambient_model.codec import load_model


def test_ctrl_c_leaves_the_best_model_so_far(process, tmp_path):
    trace, model = tmp_path / "trace.csv", tmp_path / "model.json"
    process("ambient_trainer", "simulate", "2.1", "-o", trace)
    terminal, end = pty.openpty()  # the bar shows on a terminal only, and says when the search is under way
    fit = [sys.executable, "-m", "ambient_trainer", "fit", str(trace), "--circuit", "free-4", "--starts", "1000"]
    running = subprocess.Popen([*fit, "-o", str(model)], stdout=subprocess.PIPE, stderr=end, text=True)
    os.close(end)
    seen = b""
    while b"best" not in seen:
        seen += os.read(terminal, 1024)
    running.send_signal(signal.SIGINT)
    printed, _ = running.communicate(timeout=60)
    os.close(terminal)
    assert running.returncode == 1
    assert "Stopped before the search was over: this is the best so far." in printed
    assert load_model(str(model)).provenance["fit"]["stopped"] is True
    assert json.loads(model.read_text())["name"] == "free-4"
