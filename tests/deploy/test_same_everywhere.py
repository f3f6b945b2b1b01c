"""The same replay is the same bytes: by whichever Python, as whoever, from wherever, in whatever environment."""

import glob
import json
import math
import os
import shutil
import sys
import tempfile
from pathlib import Path

import pytest

from ambient_model.codec import encode
from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model
from processes import ran

ROOT = Path(__file__).resolve().parents[2]

INPUTS = tuple(Input(name, "degC", f"{name}-therm", -20.0, 90.0) for name in ("usb", "battery", "cpu", "skin", "modem"))


def ugly(rows, columns, scale):
    """Numbers whose sums depend on the order and the way in which they are added."""
    return tuple(tuple(scale * math.sin(1 + 7 * row + 3 * column) for column in range(columns)) for row in range(rows))


def estimator(inputs, states=4):
    matrices = ((states, states, 0.2), (states, len(inputs), 0.3), (1, states, 1.1), (1, len(inputs), 0.7))
    discrete = (Discrete(1.0, *(ugly(*each) for each in matrices)),)
    bands = {50: (-0.1, 0.2), 90: (-0.3, 0.5), 98: (-0.7, 1.1)}
    names = tuple(f"x{k}" for k in range(states))
    return Estimator(inputs, names, discrete, -1.3, ugly(states, len(inputs), 0.4), bands)


def trace():
    """Gaps, losses, a jitter, and digits without end."""
    yield ",".join(["time_s", *(each.column for each in INPUTS)])
    for k in range(600):
        values = [repr(30 + 5 * math.sin(k / (40 + 7 * n)) + n / 3) for n in range(len(INPUTS))]
        if 100 <= k < 110 or 200 <= k < 240:
            values[k // 200] = ""
        yield f"{k + (0.25 if k % 7 == 0 else 0) + (40 if k > 400 else 0)!r},{','.join(values)}"


@pytest.fixture(scope="module")
def case(zipapp):
    """The one file, a model as large as real ones and a trace, in a folder that everyone may enter."""
    main = estimator(INPUTS)
    without = {"battery": estimator(tuple(each for each in INPUTS if each.name != "battery"))}
    rows = conformance_of(main, tuple(tuple(20.0 + k + n for n in range(len(INPUTS))) for k in range(6)))
    # its name is one that a locale may stumble over
    model = Model("Tastentelefon \u00fc\u2603", "2024", "ambient_degC", main, without, {}, rows)
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        case = Path(folder)
        (case / "trace.csv").write_text("\n".join(trace()) + "\n")
        (case / "model.json").write_text(encode(model))
        shutil.copy(zipapp, case / "ambientd.pyz")
        for path in case.iterdir():
            path.chmod(0o644)
        yield case


def outputs(words, case, out, **options):
    """The bytes of a replay into a file, and of a run into a pipe."""
    options = {"cwd": "/", "env": {}, "text": False, **options}
    model, trace = case / "model.json", case / "trace.csv"
    ran(*words, "replay", model, trace, "-o", out, **options)
    said = ran(*words, "run", "--model", model, "--replay", trace, "--speed", "0", **options).stdout
    content = out.read_bytes()
    out.unlink()
    return content, said


@pytest.fixture(scope="module")
def reference(case):
    """What this Python says, from the sources."""
    content, said = outputs([sys.executable, "-m", "ambientd"], case, case / "reference.csv", env=SOURCES)
    assert len(content.splitlines()) == 601
    assert len(said.splitlines()) == 600
    statuses = {json.loads(line)["status"] for line in said.splitlines()}
    assert statuses == {"warming_up", "tracking", "coasting", "degraded"}
    return content, said


PATTERNS = ("/usr/bin/python3.1[0-9]", "/usr/local/bin/python3.1[0-9]", "~/.pyenv/versions/*/bin/python3.1[0-9]")
FOUND = [Path(each) for pattern in PATTERNS for each in sorted(glob.glob(os.path.expanduser(pattern)))]
PYTHONS = {each.name.removeprefix("python"): str(each) for each in reversed(FOUND)}
"""One Python of each version that this machine has."""


@pytest.mark.parametrize("version", ["3.10", "3.11", "3.12", "3.13", "3.14"])
def test_every_python_says_the_same(version, case, reference):
    if version not in PYTHONS:
        pytest.skip(f"no Python {version} on this machine")
    words = [PYTHONS[version], "-I", "-S", str(case / "ambientd.pyz")]
    assert outputs(words, case, case / "version.csv") == reference


ENVIRONMENTS = {
    "bare": {},
    "POSIX": {"LANG": "POSIX", "PYTHONHASHSEED": "1", "PYTHONOPTIMIZE": "2"},
    "Turkish": {"LC_ALL": "tr_TR.UTF-8", "TZ": "Asia/Kathmandu", "PYTHONHASHSEED": "4242"},
    "German in Latin-1": {"LC_ALL": "de_DE.ISO-8859-1", "PYTHONINTMAXSTRDIGITS": "640"},
    "no UTF-8 mode": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "ASCII streams": {"PYTHONIOENCODING": "ascii:strict"},
}
SOURCES = {"PYTHONPATH": f"{ROOT / 'shared'}:{ROOT / 'daemon'}"}
"""The sources, since -I would shut the environment out."""


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_every_environment_says_the_same(name, case, reference):
    """And escapes letters that a locale lacks."""
    env = {**SOURCES, **ENVIRONMENTS[name]}
    words = [sys.executable, "-m", "ambientd"]
    assert outputs(words, case, case / "environment.csv", env=env) == reference
    done = ran(*words, "check", "--model", case / "model.json", env=env, text=False)
    assert b"Tastentelefon" in done.stdout
    assert b"Traceback" not in done.stderr
