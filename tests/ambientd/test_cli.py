"""Calls: what is wrong with one ends with status 2 or 1 and a message, never with a traceback."""

import os
import sys

import pytest

from processes import ran


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "the following arguments are required: COMMAND"),
        (("fly",), "invalid choice: 'fly'"),
        (("run",), "one of the arguments --config --model is required"),
        (("run", "--model", "m", "--config", "c"), "not allowed with argument"),
        (("run", "--model", "m", "--publish", "file"), "'file' has no path; write file:PATH"),
        (("run", "--model", "m", "--rate", "0"), "argument --rate: 0 is not between 0.1 and 1e+06"),
        (("run", "--model", "m", "--rate", "fast"), "argument --rate: 'fast' is not a number"),
        (("run", "--model", "m", "--rate", "nan"), "argument --rate: nan is not between 0.1 and 1e+06"),
        (("run", "--model", "m", "--rate", "21"), "argument --rate: 21 is not between 0.1 and 20"),
        (("run", "--model", "m", "--speed", "2"), "--speed goes with --replay"),
        (("run", "--model", "m", "--replay", "t", "--speed", "2", "--rate", "1"), "not allowed with argument"),
        (("replay", "m", "t"), "the following arguments are required: -o/--output"),
        (("watch",), "the following arguments are required: SOCKET"),
        *[(("tell", *words), "argument ") for words in (("nan",), ("300",), ("21", "--sigma", "0"))],
        (("tell",), "the following arguments are required: "),
    ],
)
def test_a_wrong_call_ends_with_2(ambientd, arguments, message):
    done = ambientd(*arguments, status=2)
    assert message in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("command", [(), ("run",), ("replay",), ("check",), ("watch",)])
def test_help_is_there(ambientd, command):
    done = ambientd(*command, "--help")
    assert done.stderr == ""
    assert done.stdout.startswith("usage: ambientd")


def test_a_reader_that_has_enough_leaves_no_traceback(model_file):
    assert ran("/bin/sh", "-c", f"{sys.executable} -m ambientd check --model {model_file} | true").stderr == ""


def test_what_was_closed_of_input_output_and_error_becomes_no_other_file(model_file, spawn, on_phone, until, path):
    call = ["/bin/sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", sys.executable, "-m", "ambientd"]
    ran(*call, "check", "--model", model_file)
    closed = spawn([*call, *on_phone(f"status:{path}")])
    until(lambda: os.path.exists(path), "it does not run")
    assert {os.readlink(f"/proc/{closed.pid}/fd/{number}") for number in range(3)} == {os.devnull}
