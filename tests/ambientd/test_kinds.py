"""A publisher or a source is one new file: added to a copy of the package, it is used by name, and nothing else
changes."""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest

import ambientd
from ambientd.publish.spec import parse
from processes import ran

PUBLISHER = """
from ambientd.publish import Quiet

KEYS = ("tag",)

def publisher(spec, patience_ms):
    return Appending(spec)

def configured(spec, place, data, fault):
    if not isinstance(data.get("tag", ""), str):
        fault(place + ".tag", "is no text", "give a text")
    return spec._replace(options=data.get("tag"))

class Appending(Quiet):
    def __init__(self, spec):
        self.spec = spec

    def publish(self, report):
        with open(self.spec.path, "a") as stream:
            print(self.spec.options, round(report.estimate.ambient_degC, 3), file=stream)

    def adapt(self, spec):
        self.spec = spec

    def close(self):
        pass
"""
SOURCE = """
from typing import NamedTuple

FORM = "{constant: DEGC}"

def location(place, value, fault):
    return Constant(value["constant"])

class Constant(NamedTuple):
    degC: float
    unit = "degC"
    absent = "never"

    def find(self, settings):
        return ["/dev/null"]

    def conversion(self, path):
        return lambda content: self.degC

    def hint(self, settings):
        return "-"
"""


@pytest.fixture
def copied(write, tmp_path):
    """Copy the package, add files to it, and run it with a configuration."""
    folder = tmp_path / "copied"
    shutil.copytree(Path(ambientd.__file__).parent, folder / "ambientd")
    before = {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.py")}

    def run(configuration, *arguments, status=0, **added):
        for name, text in added.items():
            (folder / "ambientd" / name.replace("__", "/")).with_suffix(".py").write_text(text)
        assert {path: (folder / path).read_bytes() for path in before} == before
        paths = [str(folder), *(each for each in sys.path if each.endswith("shared"))]
        call = [sys.executable, "-m", "ambientd", *arguments, "--config", write("c.json", json.dumps(configuration))]
        return ran(*call, cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}, status=status)

    return run


def test_a_new_publisher(copied, model_file, trace_file, tmp_path):
    publish = [{"kind": "append-to", "path": "a", "tag": "mine"}, "append-to:b"]
    done = copied(
        {"model": model_file, "publish": publish},
        *("run", "--replay", trace_file, "--speed", "0"),
        publish__append_to=PUBLISHER,
    )
    assert done.stdout == ""
    lines = (tmp_path / "a").read_text().splitlines()
    assert (len(lines), lines[0]) == (600, "mine 23.0")
    assert (tmp_path / "b").read_text().startswith("None 23.0")
    assert "append-to" in copied({}, "run", "--help").stdout
    wrong = {"kind": "append-to", "path": "a", "tag": 3, "mode": 1}
    done = copied({"model": model_file, "publish": [wrong]}, "check", status=1)
    assert [line.split(":")[0].strip() for line in done.stderr.splitlines()[1:]] == [
        "publish[0].mode",
        "publish[0].tag",
    ]


def test_a_new_source(copied, model_file, phone):
    configuration = {"model": model_file, "sysfs_root": str(phone.root), "sensors": {"usb": {"constant": 12.5}}}
    done = copied(configuration, "check", sources__constant=SOURCE)
    assert done.stderr == ""
    assert "sensor       usb, /dev/null: 12.5 degC" in done.stdout
    done = copied({**configuration, "sensors": {"usb": {"variable": 1}}}, "check", status=1)
    assert "{constant: DEGC}" in done.stderr


@pytest.mark.parametrize("kind", ["access", "spec", "nothing", "os.path", "", "__init__", "Stdout", "../x", "file\n"])
def test_a_helper_or_a_stranger_is_no_kind(kind):
    with pytest.raises(ValueError, match=r"known are file, file-in-place, prometheus, socket, status, stdout$"):
        parse(f"{kind}:path")
