"""A new cause is one file: a package with an entry point on the path, without touching any other file."""

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

from ambient_trainer.data.trace import save_trace

BOX = Path(__file__).parents[2] / "data" / "circuits" / "box.yaml"
MECHANISM = """
from dataclasses import dataclass
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.model import Number

@dataclass(frozen=True)
class Arc(Heat):
    cause = "arc"

def candidates(scene):
    driver = Expression("sqrt(abs(battery_current_A))^3")
    for node in scene.nodes:
        yield Arc((node,), (Number(f"arc_{node}", "W", 0.0, scale=scene.conductance(node), low=0.0),), driver)
"""
RUN = """
import json, sys
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.trace import load_trace
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox.file import kinds
from ambient_trainer.diagnosis.report import noun
from ambient_trainer.diagnosis.result import Cause
found = diagnose(load_circuit(sys.argv[1]), [load_trace(sys.argv[2])], period_s=120.0)
said = [each.cause.name for each in found.ranking]
print(json.dumps([list(kinds()), said, noun(Cause("arc", "chip"))]))
"""


def test_a_mechanism_is_one_file(boxed, tmp_path):
    trace = tmp_path / "box.csv"
    save_trace(str(trace), boxed("current_squared", 2))
    (tmp_path / "arc.py").write_text(textwrap.dedent(MECHANISM))
    described = tmp_path / "arc-1.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: arc\nVersion: 1\n")
    (described / "entry_points.txt").write_text("[ambient_trainer.diagnosis.greybox.mechanisms]\narc = arc\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(BOX), str(trace)],
        capture_output=True, text=True, timeout=120, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    kinds, tried, noun = json.loads(done.stdout)
    assert "Arc" in kinds
    assert "arc" in tried
    assert noun.endswith(", at chip")
