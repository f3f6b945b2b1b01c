"""Hostile files are refused like any other, in one message and in bounded time and memory; hostile values stay finite.

What the formats refuse is tested beside them, under ``tests/ambient_model``. Here are the bounds of the command, as a
process whose address space and processor time end where a device's would, and what comes out of the daemon whatever a
configuration, a model's coefficients, a zone or a trace hold.
"""

import json
import math
import os
import resource
import sys
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_model.codec import decode
from ambient_model.conformance import worst_difference_degC
from ambient_model.faults import Refused
from ambient_model.model import LEVELS_PERCENT
from ambient_model.tracking import COASTING, DEGRADED, FAULTED, TRACKING, WARMING_UP
from ambientd.config import StateSpec, load_settings
from ambientd.fallback import FallbackTracker
from ambientd.publish.prometheus import exposition
from ambientd.report import Report, as_json
from ambientd.state import StateFile
from documents import anything, at, damaged, ways, with_value
from processes import ran

from .conftest import WHOLE

MEMORY = 96 * 2**20
"""Address space, of which a bare interpreter takes a third; the unit allows 64 MiB of memory."""
CPU_S = 30
LARGEST_MODEL, LARGEST_CONFIG = 2**20, 2**16


def limited():
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))


def ambientd(*arguments):
    return ran(sys.executable, "-m", "ambientd", *arguments, status=None, timeout=120, preexec_fn=limited)


def refusal(*arguments):
    """The message of a command that refuses, and nothing worse."""
    done = ambientd(*arguments)
    assert (done.returncode, done.stdout) == (1, ""), done.stderr[-500:]
    assert done.stderr.startswith("ambientd: ")
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < 50_000, "it goes to a log"
    assert "\x1b" not in done.stderr
    return done.stderr


def filled(pattern, largest, head="", tail=""):
    """A text of the largest size that is read, with ``pattern`` as often as it goes."""
    count = (largest - len(head) - len(tail)) // (len(pattern) + 1)
    return head + ",".join([pattern] * count) + tail


MODELS = {
    # key: the pattern that fills its value, and what stands around the patterns
    "lists for states": ("states", "[]", "[", "]"),
    "one state over and over": ("states", '"a"', "[", "]"),
    "many fallbacks": ("fallbacks", "{}", "[", "]"),
    "many rows": ("initial", "[]", "[", "]"),
    "a deep wide document": ("provenance", "NaN", '{"a":' + "[" * 800, "]" * 800 + "}"),
    "a long key over wide lists": ("provenance", "NaN", '{"' + "k" * 500_000 + '":[', "]}"),
    "a name of escapes": ("name", "\\u001b[2J", '"', '"'),
    "many sequences": ("conformance", '{"period_s":1,"values":[]}', '{"inputs":[[0,0]],"outputs":[', "]}"),
    "a key over and over": ("offset", '"n":0', "0,", ""),
}


@pytest.mark.parametrize("case", MODELS)
def test_a_model_file_that_swells_is_refused(case, model_file, write):
    key, pattern, head, tail = MODELS[case]
    rest = {name: value for name, value in json.loads(Path(model_file).read_text()).items() if name != key}
    text = filled(pattern, LARGEST_MODEL, f'{json.dumps(rest)[:-1]}, "{key}": {head}', tail + "}")
    assert LARGEST_MODEL / 2 < len(text) <= LARGEST_MODEL
    refusal("check", "--model", write("hostile.json", text))


@pytest.mark.slow
def test_the_most_that_a_model_may_ask_for_is_computed_in_time(model_file, write):
    """Every count at its limit, powers of A that take all doublings, and periods that are many of the shortest."""
    data = json.loads(Path(model_file).read_text())
    states, periods = 16, [*[k / 1000 for k in range(1, 16)], 1]
    names = [f"i{k}" for k in range(32)]
    dense = [[(1 - 1e-10) / states] * states for _ in range(states)]

    def estimator(inputs):
        wide = [[0.01] * len(inputs)] * states
        matrices = {"A": dense, "B": wide, "C": [[0] * states], "D": [[0] * len(inputs)]}
        return {
            "inputs": [{**data["inputs"][0], "name": name} for name in inputs],
            "states": [f"s{k}" for k in range(states)],
            "discrete": [{"period_s": period_s, **matrices} for period_s in periods],
            "offset": 0,
            "initial": wide,
            "interval": data["interval"],
        }

    data.update(estimator(names))
    data["fallbacks"] = [{"without": name, **estimator([each for each in names if each != name])} for name in names]
    outputs = [{"period_s": period_s, "values": [0] * 100} for period_s in periods]
    data["conformance"] = {"inputs": [[20] * 32] * 100, "outputs": outputs}
    text = json.dumps(data, separators=(",", ":"))
    while len(text) > LARGEST_MODEL:
        data["fallbacks"].pop()
        text = json.dumps(data, separators=(",", ":"))
    done = ambientd("check", "--model", write("hostile.json", text))
    assert done.returncode in (0, 1), done.stderr[-500:]
    assert "conformance" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("kind", ["a pipe", "an endless device", "a folder", "100 MB of it", "nothing but zeros"])
def test_what_has_no_end_is_no_model_configuration_or_state(kind, model_file, make_model, tmp_path):
    texts = {"m.json": Path(model_file).read_text(), "c.json": json.dumps({"model": model_file}), "c.yaml": "model: m"}
    for name, text in texts.items():
        path = tmp_path / f"hostile-{name}"
        if kind == "a pipe":
            os.mkfifo(path)
        elif kind == "an endless device":
            path.symlink_to("/dev/zero")
        elif kind == "a folder":
            path.mkdir()
        else:
            path.write_text(text if kind == "100 MB of it" else "")
            with path.open("ab") as stream:
                stream.truncate(10**8)
        said = refusal("check", "--model" if name == "m.json" else "--config", path)
        assert said.startswith(f"ambientd: {path}: "), "no regular file, a folder, or too large"
        assert len(said.splitlines()) == 1
    notes = []
    StateFile(StateSpec(str(path)), "", notes.append).take_back(FallbackTracker(make_model(), 1.0), 0.0)
    assert len(notes) == 1
    assert notes[0].startswith(f"state {path}: ")


def test_neither_an_endless_device_nor_a_header_of_a_megabyte_is_a_trace(model_file, write, tmp_path):
    wide = write("wide.csv", ",".join(["time_s", *(f"{k:x}_A" for k in range(100_000))]) + "\n")
    assert "no column 'usb_degC'" in refusal("replay", model_file, wide, "-o", tmp_path / "out.csv")
    assert "/dev/zero: line 1: " in refusal("replay", model_file, "/dev/zero", "-o", tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()


NINE = ", ".join(["ha"] * 9)
LAUGHS = "\n".join([f"a0: &a0 [{NINE}]", *[f"a{k}: &a{k} [{NINE.replace('ha', f'*a{k - 1}')}]" for k in range(1, 12)]])
CONFIGS = {
    # the text, and what its message names
    "a billion laughs": (f"{LAUGHS}\nrate_hz: *a11\n", "alias"),
    "a list in itself": ("rate_hz: &a [*a]\n", "alias"),
    "deep mappings": ("{a: " * 10_000, "nested"),
    "many publishers": (filled("'file:x'", LARGEST_CONFIG, "model: m\npublish: [", "]"), "at most 32"),
    "many keys and one twice": ("\n".join(f"k{n}: 0" for n in range(6_000)) + "\nk5999: 1", "'k5999'"),
    "a long text": (f"model: {'m' * 60_000}\n", "60000 characters"),
    "a number beyond any float": (f"rate_hz: 0x{'f' * 900}\n", "0.1 and 20"),
    "a clock beyond any float": (f"rate_hz: {'1:' * 400}1.5\n", "tag"),
    "a lying timestamp": ("rate_hz: !!timestamp x\n", "tag"),
    "a call": ("rate_hz: !!python/object/apply:os.system ['true']\n", "constructor"),
    "a path with a NUL": ('model: "m\\0.json"\n', "printable"),
    "escapes for a terminal": ('"\\e[2J": 1\nmodel: m\n', "'\\x1b[2J'"),
    "many sensor kinds": (
        "model: m\nsensors: {a: {" + ", ".join(f"k{n}: 1" for n in range(6_000)) + "}}",
        "sensors.a: ",
    ),
    "JSON: deep": ('{"a":' * 10_000, "correct it"),
    "JSON: a lone surrogate": ('{"model": "\\ud800"}', "printable"),
    "JSON: a long integer": ('{"model": "m", "rate_hz": 1' + "0" * 5_000 + "}", "correct it"),
    "JSON: a long key": ('{"model": "m", "' + "k" * 60_000 + '": 1}', "unknown key"),
}


@pytest.mark.parametrize("case", CONFIGS)
def test_a_hostile_configuration_is_refused(case, write):
    text, fact = CONFIGS[case]
    assert len(text) <= LARGEST_CONFIG
    path = write(f"hostile.{'json' if case.startswith('JSON') else 'yaml'}", text)
    assert fact in refusal("check", "--config", path)


DATA = json.loads((Path(__file__).parents[1] / "data" / "model-v1.json").read_text())

COEFFICIENTS = [
    way
    for way in ways(DATA)
    if way[0] in ("discrete", "initial", "fallbacks") and isinstance(way[-1], int) and isinstance(at(DATA, way), float)
]


@st.composite
def retuned(draw):
    """The document with some of its coefficients replaced by others, up to the largest: most of it is still a model."""
    data = DATA
    for _ in range(draw(st.integers(1, 4))):
        value = draw(st.floats(-1, 1)) * 10.0 ** draw(st.sampled_from([0, 0, 0, 3, 12, 300]))
        data = with_value(data, *draw(st.sampled_from(COEFFICIENTS)), value=value)
    return data


finite = st.floats(allow_nan=False, allow_infinity=False)
readings = st.none() | st.floats(-30, 90) | finite | st.sampled_from([-1e30, 1e12, -1e12, 59.9, 60.0, 80.0])
moments_s = st.floats(0, 5) | st.sampled_from([0.05, 1.0, 29.0, 31.0, 1e9, 1e30, -3.0])
samples = st.lists(st.tuples(moments_s, st.lists(readings, min_size=1, max_size=3)), min_size=1, max_size=12)


def assert_sound(model, tracker, drawn):
    """Every estimate is finite or none, and its status follows from what could be trusted."""
    now_s, lost, inputs = 0.0, False, model.main.inputs
    for passed_s, values in drawn:
        now_s += passed_s
        raw = [values[index % len(values)] for index in range(len(inputs))]
        estimate = tracker.update(now_s, raw)
        each_trusted = [value is not None and each.min <= value <= each.max for each, value in zip(inputs, raw)]
        trusted = all(each_trusted)
        lost = lost or not trusted
        assert estimate.status != DEGRADED or any(each_trusted)
        # after a loss, a fallback that has settled is active until the main estimator has
        well = (WARMING_UP, TRACKING, DEGRADED) if lost and model.fallbacks else (WARMING_UP, TRACKING)
        assert estimate.status in well or not trusted or estimate.status == FAULTED
        assert estimate.status in (DEGRADED, COASTING, FAULTED) or trusted
        if estimate.status == FAULTED:
            assert estimate[:3] == (None, None, None)
        else:
            assert all(map(math.isfinite, estimate[:3]))
            assert estimate.low_degC <= estimate.high_degC
        report = Report(model.name, inputs, 90, now_s, raw, estimate, 0.0)
        json.loads(as_json(report), parse_constant=pytest.fail)
        assert not {"nan", "inf", "-inf"} & set(exposition(report).split())


REST = [(1.0, [25.0])] * 4


@given(retuned(), samples)
@example(with_value(DATA, "discrete", 0, "period_s", value=1e-300), REST)
@example(with_value(DATA, "discrete", 0, "period_s", value=1e300), REST)
@example(with_value(DATA, "discrete", 0, "B", 0, 0, value=1e308), REST)
@example(with_value(DATA, "discrete", 0, "C", 0, 0, value=1e308), REST)
@example(with_value(DATA, "initial", 0, 0, value=1e308), REST)
@example(with_value(DATA, "interval", "98", value=[-1.7e308, 1.7e308]), REST)
@example(with_value(DATA, "inputs", 0, "max", value=1e308), [(1.0, [1e30])] * 4)
@example(with_value(DATA, "discrete", 0, "A", 0, 1, value=1e12), [(1.0, [1e12, 25.0])] * 40)
@settings(max_examples=60)
def test_a_model_of_any_coefficients_runs_sound_or_is_refused(data, drawn):
    try:
        model = decode(json.dumps(data).encode(), "hostile.json")
    except Refused:
        return
    assert worst_difference_degC(model) >= 0
    for level in LEVELS_PERCENT:
        assert_sound(model, FallbackTracker(model, 1.0, level), drawn)


numbers = st.sampled_from([0, -0.0, 1, 1e-320, 0.999999, 1e12, -1e12, 1e300, 10**400])
"""As YAML, or JSON, which is YAML, too."""

WORDS = "model zones publish rate_hz &a *a << !!float !!int !!set !!omap !!binary !!timestamp !x !!python/tuple no"
VALUES = '\'\' "\\0" "\\ud800" 0x 0b_ 1:59:59 .inf .nan 2001-13-41 = ~ 1e999 @ ` \x85 \u2028 \ufeff'
SIGNS = [*"{}[]|#\n\t", ": ", "- ", "? ", "\n  ", ", ", ">-\n", "---\n", "...\n", "%YAML 1.1\n"]
tokens = st.sampled_from([*[f"{word} " for word in WORDS.split()], *VALUES.split(" "), *SIGNS])

texts = damaged(WHOLE, anything(numbers)).map(json.dumps) | st.lists(tokens, max_size=25).map("".join)


@given(texts | st.text(max_size=60), st.sampled_from(["json", "yaml"]))
@example("model: m\nzones: {? [a, b] : c}", "yaml")
@example("!!omap [a: 1]", "yaml")
@example("!!pairs {a: 1}", "yaml")
@example("=: 1", "yaml")
@settings(max_examples=200)
def test_any_configuration_is_taken_or_refused(tmp_path_factory, text, suffix):
    path = tmp_path_factory.getbasetemp() / f"any.{suffix}"
    path.write_text(text, encoding="utf-8", newline="")
    found, message = None, ""
    try:
        found = load_settings(str(path))
    except Refused as refused:
        message = str(refused)
    assert found is None or (found.model and math.isfinite(found.rate_hz))
    assert found is None or all(0 <= (spec.access.mode or 0) <= 0o777 for spec in found.publish)
    assert (found is None) == message.startswith(f"{path}: ")
    assert message.replace("\n", " ").isprintable(), "it goes to a terminal"
