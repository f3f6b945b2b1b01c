"""A new cause is one file: a package with an entry point on the path, without touching any other file."""

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

from ambient_trainer.data.trace import save_trace

BOX = Path(__file__).parents[2] / "data" / "circuits" / "box.yaml"
CAUSE = """
import numpy as np
from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Span, constant, first_coefficient
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.diagnosis.terms import HeatTerm

def _candidates(setting):
    for node, name in enumerate(setting.plant.nodes):
        for signal in setting.signals:
            def terms(view, node=node, signal=signal):
                return (HeatTerm(np.abs(view.signal(signal)) ** 1.8, setting.into(node, constant)),)
            yield Candidate(Cause("arc", name, signal), Span.WHOLE, terms, first_coefficient("W", "heat of an arc"))

KIND = CauseKind("arc", "an arc", "an arc heats {place}", _candidates)
"""
RUN = """
import json, sys
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.trace import load_trace
from ambient_trainer.diagnosis.causes import cause_kinds, noun
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.result import Cause
found = diagnose(load_circuit(sys.argv[1]), [load_trace(sys.argv[2])], period_s=120.0)
said = [each.cause.name for each in found.ranking]
print(json.dumps([list(cause_kinds()), said, noun(Cause("arc", "chip"))]))
"""


def test_a_cause_is_one_file(boxed, tmp_path):
    trace = tmp_path / "box.csv"
    save_trace(str(trace), boxed("current_squared", 2))
    (tmp_path / "arc.py").write_text(textwrap.dedent(CAUSE))
    described = tmp_path / "arc-1.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: arc\nVersion: 1\n")
    (described / "entry_points.txt").write_text("[ambient_trainer.diagnosis.causes]\narc = arc\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(BOX), str(trace)],
        capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    kinds, tried, noun = json.loads(done.stdout)
    assert "arc" in kinds
    assert "arc" in tried
    assert noun == "an arc, at chip"
