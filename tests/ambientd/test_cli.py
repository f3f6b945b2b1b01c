"""Calls: what is wrong with one ends with status 2 or 1 and a message, never with a traceback."""

import json
import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "the following arguments are required: COMMAND"),
        (("fly",), "invalid choice: 'fly'"),
        (("run",), "one of the arguments --config --model is required"),
        (("run", "--model", "m", "--config", "c"), "not allowed with argument"),
        (("run", "--model", "m", "--publish", "mqtt:x"), "'mqtt' is no kind of publisher; known are file, file-in-"),
        (("run", "--model", "m", "--publish", "file"), "'file' has no path; write file:PATH"),
        (("run", "--model", "m", "--rate", "0"), "argument --rate: 0 is not between 0.1 and 1e+06"),
        (("run", "--model", "m", "--rate", "fast"), "argument --rate: 'fast' is not a number"),
        (("run", "--model", "m", "--rate", "nan"), "argument --rate: nan is not between 0.1 and 1e+06"),
        (("run", "--model", "m", "--rate", "21"), "argument --rate: 21 is not between 0.1 and 20"),
        (("run", "--model", "m", "--speed", "2"), "--speed goes with --replay"),
        (("run", "--model", "m", "--replay", "t", "--speed", "2", "--rate", "1"), "not allowed with argument"),
        (("replay", "m", "t"), "the following arguments are required: -o/--output"),
        (("watch",), "the following arguments are required: SOCKET"),
    ],
)
def test_a_wrong_call_ends_with_2(ambientd, arguments, message):
    done = ambientd(*arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("command", [(), ("run",), ("replay",), ("check",), ("watch",)])
def test_help_is_there(ambientd, command):
    done = ambientd(*command, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage: ambientd")


@pytest.mark.parametrize("command", [("run", "--model"), ("check", "--model")])
def test_a_model_that_is_not_there_ends_with_1(ambientd, command, tmp_path):
    done = ambientd(*command, tmp_path / "none.json")
    assert done.returncode == 1
    assert done.stderr.startswith(f"ambientd: {tmp_path}/none.json: cannot be read (No such file or directory)")


def test_a_reader_that_has_enough_leaves_no_traceback(model_file):
    command = f"{sys.executable} -m ambientd check --model {model_file} | true"
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, timeout=30)
    assert done.stderr == ""


BARE = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {blocked!r}:
            raise ImportError(name + " is blocked")

sys.meta_path.insert(0, Blocker())
from ambientd.__main__ import main
sys.argv = ["ambientd", *{arguments!r}]
status = main()
print(*sorted(sys.modules), file=sys.stderr)
sys.exit(status)
"""
HOST = ("numpy", "scipy", "yaml", "serial", "click", "rich", "jinja2", "plotly", "pydantic", "ambient_trainer")
HEAVY = {"dataclasses", "pathlib", "asyncio", "logging", "tempfile", "subprocess", "inspect"}


def bare(*arguments):
    code = BARE.format(blocked=HOST, arguments=[str(each) for each in arguments])
    return subprocess.run([sys.executable, "-I", "-c", code], capture_output=True, text=True, timeout=30)


def test_the_device_needs_nothing_but_python(model_file, trace_file, phone, tmp_path):
    out = tmp_path / "out.csv"
    for arguments in (
        ("check", "--model", model_file, "--sysfs-root", phone.root),
        ("replay", model_file, trace_file, "-o", out),
        ("run", "--model", model_file, "--replay", trace_file, "--speed", "0"),
    ):
        done = bare(*arguments)
        assert done.returncode == 0, done.stderr
        # what an editable install's own start-up loads is not the daemon's doing
        loaded = set(done.stderr.split()) - start_up_modules()
        assert not loaded & HEAVY, arguments
    assert len(out.read_text().splitlines()) == 601


def start_up_modules():
    done = subprocess.run(
        [sys.executable, "-I", "-c", "import sys; print(*sys.modules)"], capture_output=True, text=True, timeout=30
    )
    return set(done.stdout.split())


def test_a_replay_imports_neither_sockets_nor_what_else_it_does_not_use(model_file, trace_file, tmp_path):
    loaded = set(bare("replay", model_file, trace_file, "-o", tmp_path / "o.csv").stderr.split())
    unwanted = {"socket", "select", "signal", "ambientd.publish.socket", "ambientd.run", "ambientd.sources.zone"}
    assert not (loaded - start_up_modules()) & unwanted


def test_without_pyyaml_a_yaml_configuration_says_what_to_do(model_file, phone, tmp_path):
    config = tmp_path / "c.yaml"
    config.write_text("model: model.json\n")
    done = bare("check", "--config", config)
    assert done.returncode == 1
    assert done.stderr.startswith(f"ambientd: {config}: ")
    assert "'ambientd[yaml]'" in done.stderr
    as_json = tmp_path / "c.json"
    as_json.write_text(json.dumps({"model": "model.json", "sysfs_root": str(phone.root)}))
    assert bare("check", "--config", as_json).returncode == 0
