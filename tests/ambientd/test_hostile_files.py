"""A file that was made to do harm is refused like any other: in one message, in bounded time and memory.

The command runs as a process of its own whose address space and processor time end where a device's would.
"""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from ambientd.config import StateSpec
from ambientd.fallback import FallbackTracker
from ambientd.state import StateFile

MEMORY = 96 * 2**20
"""Address space, of which a bare interpreter takes a third; the unit allows 64 MiB of memory."""
CPU_S = 30
LARGEST_MODEL, LARGEST_CONFIG = 2**20, 2**16


def limited():
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))


def ambientd(*arguments):
    words = [sys.executable, "-m", "ambientd", *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, timeout=120, preexec_fn=limited)


def refusal(*arguments):
    """What the command says when it refuses, and nothing worse."""
    done = ambientd(*arguments)
    assert done.returncode == 1, (done.returncode, done.stderr[-500:])
    assert "Traceback" not in done.stderr
    assert done.stderr.startswith("ambientd: ")
    assert len(done.stderr) < 50_000, "a log takes this, too"
    assert done.stdout == ""
    return done.stderr


def filled(pattern, largest, head="", tail=""):
    """A text of the largest size that is read, with ``pattern`` as often as it goes."""
    count = (largest - len(head) - len(tail)) // (len(pattern) + 1)
    return head + ",".join([pattern] * count) + tail


def without(data, key):
    """The JSON of ``data`` with ``key``'s value left open at the end: the head and the tail around it."""
    rest = {name: value for name, value in data.items() if name != key}
    return f'{json.dumps(rest)[:-1]}, "{key}": ', "}"


def square(value, size):
    return json.dumps([[value] * size] * size)


def slow_and_dense(states):
    """A matrix whose powers shrink so slowly that its stability takes all the doublings that there are."""
    return [[(1 - 1e-10) / states] * states for _ in range(states)]


MODELS = {
    "lists for states": ("states", lambda head, tail: filled("[]", LARGEST_MODEL, head + "[", "]" + tail)),
    "numbers for inputs": ("inputs", lambda head, tail: filled("0", LARGEST_MODEL, head + "[", "]" + tail)),
    "one state over and over": ("states", lambda head, tail: filled('"a"', LARGEST_MODEL, head + "[", "]" + tail)),
    "many fallbacks": ("fallbacks", lambda head, tail: filled("{}", LARGEST_MODEL, head + "[", "]" + tail)),
    "many periods": ("discrete", lambda head, tail: filled("{}", LARGEST_MODEL, head + "[", "]" + tail)),
    "many rows": ("initial", lambda head, tail: filled("[]", LARGEST_MODEL, head + "[", "]" + tail)),
    "a deep wide document": (
        "provenance",
        lambda head, tail: filled("NaN", LARGEST_MODEL, head + '{"a":' + "[" * 800, "]" * 800 + "}" + tail),
    ),
    "a long key over wide lists": (
        "provenance",
        lambda head, tail: filled("NaN", LARGEST_MODEL, head + '{"' + "k" * 500_000 + '":[', "]}" + tail),
    ),
    "a long name": ("name", lambda head, tail: head + '"' + "n" * 1_000_000 + '"' + tail),
    "a name of escapes": ("name", lambda head, tail: head + '"' + "\\u001b[2J" * 100_000 + '"' + tail),
    "sequences for many periods": (
        "conformance",
        lambda head, tail: filled(
            '{"period_s":1,"values":[]}', LARGEST_MODEL, head + '{"inputs":[[0,0]],"outputs":[', "]}" + tail
        ),
    ),
    "unknown keys": ("offset", lambda head, tail: head + "0," + ",".join(f'"{n}":0' for n in range(80_000)) + tail),
    "a key twice at the far end": (
        "offset",
        lambda head, tail: head + "0," + ",".join(f'"{n}":0' for n in range(90_000)) + ',"89999":1' + tail,
    ),
}


@pytest.mark.parametrize("case", MODELS)
def test_a_model_file_that_swells_is_refused(case, model_file, tmp_path):
    key, make = MODELS[case]
    text = make(*without(json.loads(Path(model_file).read_text()), key))
    assert LARGEST_MODEL / 2 < len(text) <= LARGEST_MODEL
    path = tmp_path / "hostile.json"
    path.write_text(text)
    refusal("check", "--model", path)


def test_a_matrix_that_is_too_large_is_refused_unmultiplied(model_file, tmp_path):
    data = json.loads(Path(model_file).read_text())
    size = 400
    data["states"] = [f"s{k}" for k in range(size)]
    data["discrete"][0]["A"] = [[0] * size] * size
    path = tmp_path / "hostile.json"
    path.write_text(json.dumps(data, separators=(",", ":")))
    assert "states: has 400 entries; at most 16 are wanted" in refusal("check", "--model", path)


def test_the_most_that_a_model_may_ask_for_is_computed_in_time(model_file, tmp_path):
    """Every count at its limit, every matrix as slow to judge as can be, and periods that are many of the shortest."""
    data = json.loads(Path(model_file).read_text())
    states, periods = 16, [*[k / 1000 for k in range(1, 16)], 1]
    names = [f"i{k}" for k in range(32)]

    def estimator(inputs):
        wide = [[0.01] * len(inputs)] * states
        return {
            "inputs": [{**data["inputs"][0], "name": name} for name in inputs],
            "states": [f"s{k}" for k in range(states)],
            "discrete": [
                {"period_s": p, "A": slow_and_dense(states), "B": wide, "C": [[0] * states], "D": [[0] * len(inputs)]}
                for p in periods
            ],
            "offset": 0,
            "initial": wide,
            "interval": data["interval"],
        }

    data.update(estimator(names))
    data["fallbacks"] = [{"without": name, **estimator([each for each in names if each != name])} for name in names]
    data["conformance"] = {
        "inputs": [[20] * 32] * 100,
        "outputs": [{"period_s": p, "values": [0] * 100} for p in periods],
    }
    text = json.dumps(data, separators=(",", ":"))
    while len(text) > LARGEST_MODEL:
        data["fallbacks"].pop()
        text = json.dumps(data, separators=(",", ":"))
    path = tmp_path / "hostile.json"
    path.write_text(text)
    done = ambientd("check", "--model", path)
    assert done.returncode in (0, 1), done.stderr[-500:]
    assert "conformance" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.fixture(params=["a pipe", "an endless device", "a folder", "100 MB of it", "nothing but zeros"])
def unending(request, tmp_path):
    """Put what must not be read to its end at a path."""

    def put(name, text):
        path = tmp_path / name
        if request.param == "a pipe":
            os.mkfifo(path)
        elif request.param == "an endless device":
            path.symlink_to("/dev/zero")
        elif request.param == "a folder":
            path.mkdir()
        elif request.param == "100 MB of it":
            path.write_text(text)
            with path.open("a") as stream:
                for _ in range(100):
                    stream.write(" " * 10**6)
        else:
            with path.open("wb") as stream:
                stream.truncate(10**11)
        return path

    return put


def test_what_has_no_end_is_no_model(unending, model_file):
    path = unending("hostile.json", Path(model_file).read_text())
    reasons = ("is no regular file", "cannot be read (Is a directory)", "larger than 1 MiB")
    assert any(f"{path}: {reason}" in refusal("check", "--model", path) for reason in reasons)


@pytest.mark.parametrize("suffix", ["json", "yaml"])
def test_what_has_no_end_is_no_configuration(unending, model_file, suffix):
    path = unending(f"hostile.{suffix}", json.dumps({"model": model_file}))
    reasons = ("is no regular file", "cannot be read (Is a directory)", "larger than 64 KiB")
    assert any(f"{path}: {reason}" in refusal("check", "--config", path) for reason in reasons)


def test_an_endless_device_is_no_trace(model_file, tmp_path):
    said = refusal("replay", model_file, "/dev/zero", "-o", tmp_path / "out.csv")
    assert "/dev/zero: line 1: not CSV (a line of more than 1048576 characters)" in said
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize("kind", ["a pipe", "an endless device", "a folder"])
def test_what_has_no_end_is_no_state(kind, make_model, tmp_path):
    path = tmp_path / "state"
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind == "a folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero")
    told = []
    model = make_model()
    StateFile(StateSpec(str(path)), model, told.append).take_back(FallbackTracker(model, 1.0), 0.0)
    reason = "cannot be read (Is a directory)" if kind == "a folder" else "is no regular file"
    assert told == [f"state {path}: {reason}; starting anew"]


LAUGHS = "\n".join(
    [
        "a0: &a0 [ha, ha, ha, ha, ha, ha, ha, ha, ha]",
        *[f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)],
    ]
)

CONFIGS = {
    "a billion laughs": (f"{LAUGHS}\nrate_hz: *a11\n", "is used again by an alias: write it twice"),
    "laughs for a key": ("? {a: &a [ha, ha], b: [*a, *a]}\n: 1\n", "what begins in line 1 is used again by an alias"),
    "a list in itself": ("rate_hz: &a [*a]\n", "what begins in line 1 is used again by an alias: write it twice"),
    "a mapping in itself": ("&a\nrate_hz: *a\n", "what begins in line 1 is used again by an alias: write it twice"),
    "a merge": ("zones: &z {a: b}\nsensors: {<<: *z}\n", "what begins in line 1 is used again by an alias"),
    "deep": ("[" * 30_000, "nested too deep"),
    "deep mappings": ("{a: " * 10_000, "nested too deep"),
    "deep in blocks": ("\n".join(" " * k + "a:" for k in range(350)), "a: unknown key"),
    "many publishers": (
        filled("'file:x'", LARGEST_CONFIG, "model: m\npublish: [", "]"),
        "entries; at most 32 are wanted",
    ),
    "many unknown keys": ("\n".join(f"k{n}: 0" for n in range(6_000)), "k0: unknown key"),
    "many keys and one twice": ("\n".join(f"k{n}: 0" for n in range(6_000)) + "\nk5999: 1", "key 'k5999' stands twice"),
    "a long text": (f"model: {'m' * 60_000}\n", "what stands in line 1 has 60000 characters"),
    "a long number": (f"rate_hz: 0x{'f' * 60_000}\n", "what stands in line 1 has 60002 characters"),
    "a number beyond any float": (f"rate_hz: 0x{'f' * 900}\n", "a number between 0.1 and 20 is wanted"),
    "a clock beyond any float": (f"rate_hz: {'1:' * 400}1.5\n", "a value does not fit its tag"),
    "an empty float": ("rate_hz: !!float ''\n", "a value does not fit its tag"),
    "a lying timestamp": ("rate_hz: !!timestamp x\n", "a value does not fit its tag"),
    "a lying boolean": ("rate_hz: !!bool x\n", "a value does not fit its tag"),
    "a call": ("rate_hz: !!python/object/apply:os.system ['true']\n", "could not determine a constructor"),
    "a path with a NUL": ('model: "m\\0.json"\n', "a text of at most 1000 printable characters is wanted"),
    "escapes for a terminal": ('"\\e[2J": 1\nmodel: m\n', "'\\x1b[2J': unknown key"),
}


@pytest.mark.parametrize("case", CONFIGS)
def test_a_configuration_that_was_made_to_do_harm_is_refused(case, tmp_path):
    text, message = CONFIGS[case]
    assert len(text) <= LARGEST_CONFIG
    path = tmp_path / "hostile.yaml"
    path.write_text(text)
    said = refusal("check", "--config", path)
    assert message in said
    assert "\x1b" not in said


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 60_000, "correct it"),
        ('{"a":' * 10_000, "correct it"),
        ('{"model": "m\\u0000.json"}', "a text of at most 1000 printable characters is wanted"),
        ('{"model": "\\ud800"}', "a text of at most 1000 printable characters is wanted"),
        ('{"model": "m", "rate_hz": 1' + "0" * 5_000 + "}", "correct it"),
        ('{"model": "m", "rate_hz": 1' + "0" * 4_000 + "}", "a number between 0.1 and 20 is wanted"),
        ('{"model": "m", "rate_hz": NaN, "coast_s": Infinity}', "rate_hz: is nan"),
        ('{"model": "m", "' + "k" * 60_000 + '": 1}', "unknown key"),
        (filled("0", LARGEST_CONFIG, '{"model": "m", "zones": [', "]}"), "zones: is [0, 0, 0"),
    ],
    ids=range(9),
)
def test_so_is_one_in_json(text, message, tmp_path):
    path = tmp_path / "hostile.json"
    path.write_text(text)
    assert message in refusal("check", "--config", path)


def test_the_limits_are_those_of_a_working_command(model_file):
    """Otherwise every test here would pass for want of memory."""
    done = ambientd("check", "--model", model_file)
    assert (done.returncode, done.stderr) == (0, "")
