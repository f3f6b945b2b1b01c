"""Whatever comes in, what goes out is finite, and nothing that rests on an untrusted reading says 'tracking'."""

import contextlib
import copy
import itertools
import json
import math
import socket
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_model.codec import decode, encode
from ambient_model.conformance import worst_difference_degC
from ambient_model.faults import Refused
from ambient_model.model import LEVELS_PERCENT
from ambient_model.tracking import COASTING, DEGRADED, FAULTED, TRACKING, WARMING_UP
from ambientd.config import load_settings
from ambientd.fallback import FallbackTracker
from ambientd.publish import open_publisher
from ambientd.publish.prometheus import exposition
from ambientd.publish.spec import Spec
from ambientd.replay import replay
from ambientd.report import Report, as_json
from ambientd.sources.assign import open_sensors

DATA = json.loads((Path(__file__).parents[1] / "data" / "model-v1.json").read_text())
numbers = (
    st.floats()
    | st.integers()
    | st.sampled_from([0, -0.0, 1, -1, 1e-320, 1e-9, 0.999999, 1e3, 1e11, 1e12, -1e12, 1e13, 1e300, 10**400, 2**63])
)
anything = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


def ways(data, way=()):
    """The path of every value in a document."""
    if way:
        yield way
    for key, value in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        yield from ways(value, (*way, key))


@st.composite
def mutated(draw, document, values=anything):
    """``document`` with one to three of its values replaced, removed, doubled or moved to a key of another name."""
    data = copy.deepcopy(document)
    for _ in range(draw(st.integers(1, 3))):
        *way, last = draw(st.sampled_from(list(ways(data))))
        place = data
        for step in way:
            place = place[step]
        what = draw(st.sampled_from(["replace", "replace", "replace", "remove", "double"]))
        if what == "replace":
            place[last] = draw(values)
        elif what == "remove":
            del place[last]
        elif isinstance(place, list):
            place.append(copy.deepcopy(place[last]))
        else:
            place[draw(st.text(max_size=5))] = place.pop(last)
    return data


COEFFICIENTS = [
    way for way in ways(DATA) if way[0] in ("discrete", "offset", "initial", "fallbacks") and isinstance(way[-1], int)
]


@st.composite
def retuned(draw):
    """The document with some of its coefficients replaced by others, up to the largest: most of it is still a model."""
    data = copy.deepcopy(DATA)
    for _ in range(draw(st.integers(1, 4))):
        *way, last = draw(st.sampled_from(COEFFICIENTS))
        place = data
        for step in way:
            place = place[step]
        if isinstance(place[last], float):
            place[last] = draw(st.floats(-1, 1)) * 10.0 ** draw(st.sampled_from([0, 0, 0, 3, 12, 300]))
    return data


def loaded(content):
    with contextlib.suppress(Refused):
        return decode(content, "hostile.json")
    return None


readings = st.none() | st.floats(-30, 90) | st.sampled_from([-1e30, 1e30, 1e12, -1e12, 59.9, 60.0, 80.0])
moments_s = st.floats(0, 5) | st.sampled_from([0.05, 1.0, 29.0, 31.0, 1e9, 1e30])


def assert_sound(model, tracker, samples):
    """Every estimate is finite or none, and has earned its status."""
    now_s = 0.0
    inputs = model.main.inputs
    lost = False
    for passed_s, drawn in samples:
        now_s += passed_s
        raw = [drawn[index % len(drawn)] for index in range(len(inputs))]
        estimate = tracker.update(now_s, raw)
        trusted = all(value is not None and each.min <= value <= each.max for each, value in zip(inputs, raw))
        lost = lost or not trusted
        # after a loss, a fallback that has settled speaks until the main estimator has
        well = (WARMING_UP, TRACKING, DEGRADED) if lost and model.fallbacks else (WARMING_UP, TRACKING)
        assert estimate.status in well or not trusted or estimate.status == FAULTED
        assert estimate.status in (DEGRADED, COASTING, FAULTED) or trusted
        said = estimate[:3]
        assert (None in said) == (estimate.status == FAULTED)
        if None in said:
            assert said == (None, None, None)
        else:
            assert all(map(math.isfinite, said))
            assert estimate.low_degC <= estimate.high_degC
        report = Report(model.name, inputs, 90, now_s, raw, estimate, 0.0)
        json.loads(as_json(report), parse_constant=pytest.fail)
        assert not {"nan", "inf", "-inf"} & set(exposition(report).split())


samples = st.lists(st.tuples(moments_s, st.lists(readings, min_size=1, max_size=3)), min_size=1, max_size=12)


def assert_runs_sound_or_refused(content, drawn):
    model = loaded(content)
    if model is None:
        return
    assert loaded(encode(model).encode()) == model
    assert worst_difference_degC(model) >= 0
    for level in LEVELS_PERCENT:
        assert_sound(model, FallbackTracker(model, 1.0, level), drawn)


@given(mutated(DATA), samples)
@settings(max_examples=300)
def test_a_mutated_model_runs_sound_or_is_refused(data, drawn):
    assert_runs_sound_or_refused(json.dumps(data).encode(), drawn)


def with_value(*way, value):
    data = copy.deepcopy(DATA)
    place = data
    for step in way[:-1]:
        place = place[step]
    place[way[-1]] = value
    return data


REST = [(1.0, [25.0])] * 4


@given(retuned(), samples)
@example(with_value("discrete", 0, "period_s", value=1e-300), REST)
@example(with_value("discrete", 0, "period_s", value=1e300), REST)
@example(with_value("discrete", 0, "B", 0, 0, value=1e308), REST)
@example(with_value("discrete", 0, "C", 0, 0, value=1e308), REST)
@example(with_value("initial", 0, 0, value=1e308), REST)
@example(with_value("interval", "98", value=[-1.7e308, 1.7e308]), REST)
@example(with_value("inputs", 0, "max", value=1e308), [(1.0, [1e30])] * 4)
@example(with_value("discrete", 0, "A", 0, 1, value=1e12), [(1.0, [1e12, 25.0])] * 40)
@settings(max_examples=300)
def test_a_model_of_any_coefficients_runs_sound_or_is_refused(data, drawn):
    assert_runs_sound_or_refused(json.dumps(data).encode(), drawn)


@given(st.integers(0, 5_000), st.binary(max_size=4), st.integers(0, 8))
@settings(max_examples=300)
def test_a_model_with_damaged_bytes_runs_sound_or_is_refused(at, piece, gone):
    content = json.dumps(DATA).encode()
    at %= len(content)
    assert_runs_sound_or_refused(content[:at] + piece + content[at + gone :], REST)


WHOLE = {
    "model": "m.json",
    "rate_hz": 10,
    "sysfs_root": "/sys",
    "level_percent": 98,
    "coast_s": 60,
    "state": {"path": "/var/lib/s", "max_age_s": 30},
    "zones_by_name": "/dev/thermal/tz-by-name",
    "zones": {"usb": "usbc-therm-adc"},
    "sensors": {
        "battery": {"power_supply": "battery", "property": "temp"},
        "current": {"power_supply": "battery", "property": "current_now", "sign": -1},
        "skin": {"hwmon": "chip", "label": "skin"},
        "cpu": {"zone": "cpu-0-0"},
    },
    "supervision": {"stuck_after_s": 1800, "stuck_within_K": 0.1, "jump_K_per_s": 20},
    "access": {"mode": "0640", "owner": 0, "group": "0"},
    "publish": [
        "stdout",
        "socket:s",
        {
            "kind": "file",
            "path": "/run/b",
            "mode": "in-place",
            "poison_millidegC": -1,
            "at_exit": "poison",
            "offset_millidegC": 7,
        },
    ],
}


def assert_settings_or_refused(path):
    said = ""
    try:
        found = load_settings(str(path))
    except Refused as refused:
        said = str(refused)
    if said:
        assert said.startswith(f"{path}: ")
        assert said.replace("\n", " ").isprintable(), "it goes to a terminal"
    else:
        assert found.model
        assert math.isfinite(found.rate_hz)


@given(mutated(WHOLE), st.sampled_from(["c.json", "c.yaml"]))
@settings(max_examples=400)
def test_a_mutated_configuration_is_taken_or_refused(tmp_path_factory, data, name):
    path = tmp_path_factory.getbasetemp() / name
    path.write_text(json.dumps(data))  # which is YAML, too
    assert_settings_or_refused(path)


WORDS = "model zones publish rate_hz &a *a << !!float !!int !!set !!omap !!binary !!timestamp !x !!python/tuple no"
VALUES = '\'\' "\\0" "\\ud800" 0x 0b_ 1:59:59 .inf .nan 2001-13-41 = ~ 1e999 @ ` \x85 \u2028 \ufeff'
SIGNS = [
    ": ",
    "- ",
    "? ",
    "\n",
    "\n  ",
    "{",
    "}",
    "[",
    "]",
    ", ",
    "|",
    ">-\n",
    "#",
    "\t",
    "---\n",
    "...\n",
    "%YAML 1.1\n",
]
tokens = st.sampled_from([*[f"{word} " for word in WORDS.split()], *VALUES.split(" "), *SIGNS])


@given(st.lists(tokens, max_size=25).map("".join) | st.text(max_size=60))
@example("model: m\nzones: {? [a, b] : c}")
@example("!!omap [a: 1]")
@example("!!pairs {a: 1}")
@example("=: 1")
@settings(max_examples=600)
def test_any_yaml_is_taken_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(text, encoding="utf-8", newline="")
    assert_settings_or_refused(path)


@given(st.binary(max_size=80), st.sampled_from(["any.json", "any.yaml"]))
@settings(max_examples=200)
def test_any_bytes_are_taken_or_refused(tmp_path_factory, content, name):
    path = tmp_path_factory.getbasetemp() / name
    path.write_bytes(content)
    assert_settings_or_refused(path)


contents = (
    st.binary(max_size=40)
    | st.integers().map(lambda value: b"%d\n" % value)
    | st.integers(-30_000, 100_000).map(lambda value: b"%d\n" % value)
    | st.sampled_from(
        [b"", b"\n", b"nan\n", b"inf\n", b"1e5\n", b"0x10\n", b"2_5000\n", b"-32768000\n", b"\xd9\xa3", b"+5"]
    )
)


@given(st.lists(st.tuples(contents, contents), min_size=1, max_size=6))
@settings(max_examples=150)
def test_any_zone_contents_leave_the_estimate_sound(sysfs_once, drawn):
    zones = [sysfs_once / f"class/thermal/thermal_zone{number}/temp" for number in range(2)]
    model = decode(json.dumps(DATA).encode(), "m.json")
    told = []
    settings_ = load_settings(str(sysfs_once / "c.json"))
    for zone in zones:
        zone.write_bytes(b"25000\n")
    sensors = open_sensors(settings_, model, told.append)
    tracker = FallbackTracker(model, 1.0)
    now_s = 0.0
    try:
        for pair in [(b"25000\n",) * 2, *drawn]:
            for zone, content in zip(zones, pair):
                zone.write_bytes(content)
            now_s += 1.0
            raw = sensors.read(now_s)
            assert all(value is None or math.isfinite(value) for value in raw)
            for content, value in zip(pair, raw):
                # an oracle of its own for what a zone's file may say
                try:
                    said = int(content.decode("ascii")) / 1000 if b"_" not in content and b"+" not in content else None
                except ValueError:
                    said = None
                assert value is None or value == said
            estimate = tracker.update(now_s, raw)
            assert estimate.status in (DEGRADED, COASTING, FAULTED) or None not in raw
            assert None in estimate[:3] or all(map(math.isfinite, estimate[:3]))
    finally:
        sensors.close()
    assert all(line.isprintable() for line in told), "what a file says may not reach a terminal as it is"


@pytest.fixture(scope="module")
def sysfs_once(tmp_path_factory):
    root = tmp_path_factory.mktemp("sys")
    for number, kind in enumerate(["usb-therm", "battery"]):
        folder = root / f"class/thermal/thermal_zone{number}"
        folder.mkdir(parents=True)
        (folder / "type").write_text(f"{kind}\n")
    (root / "c.json").write_text(json.dumps({"model": "m.json", "sysfs_root": ".", "zones_by_name": "none"}))
    return root


@given(st.lists(st.binary(max_size=3000), max_size=4), st.booleans())
@settings(max_examples=60)
def test_whatever_readers_send_the_socket_goes_on(tmp_path_factory, sent, hangs_up):
    path = tmp_path_factory.getbasetemp() / "s"
    model = decode(json.dumps(DATA).encode(), "m.json")
    estimate = FallbackTracker(model, 1.0).update(0.0, [25.0, 25.0])
    report = Report(model.name, model.main.inputs, 90, 0.0, [25.0, 25.0], estimate, 0.0)
    line = f"{as_json(report)}\n".encode()
    publisher = open_publisher(Spec("socket", str(path)), 0)
    with contextlib.closing(publisher), contextlib.ExitStack() as clients:
        quiet = clients.enter_context(socket.socket(socket.AF_UNIX))
        loud = clients.enter_context(socket.socket(socket.AF_UNIX))
        for client in (loud, quiet):
            client.connect(str(path))
            publisher.serve()
        for content in sent:
            loud.sendall(content)
            publisher.publish(report)
        if hangs_up:
            loud.shutdown(socket.SHUT_RDWR)
            loud.close()
        publisher.publish(report)
        quiet.settimeout(5)
        assert quiet.recv(2**16) == line * (len(sent) + 1)


readable = ["", "25.0", "30", "-20", "59.5", "80.0", "80.1", "1e30", "-1e30"]
cells = st.sampled_from([*readable * 8, "1e300", "9.9E+37", "nan", "x"])
times_s = st.lists(st.floats(-1e30, 1e30) | st.floats(0, 100), min_size=1, max_size=12, unique=True).map(sorted)


@given(times_s, st.lists(st.tuples(cells, cells), min_size=1, max_size=12))
@example([-1e30, 1e30], [("25", "25")])
@example([0.0, 5e-324, 1e-300], [("25", "25")])
@example([0.0, 1.0, 2.0], [("1e300", "25")])
@settings(max_examples=200)
def test_any_trace_is_replayed_finite_or_refused(tmp_path_factory, times, drawn):
    folder = tmp_path_factory.getbasetemp()
    model, trace, out = (str(folder / name) for name in ("model.json", "trace.csv", "out.csv"))
    Path(model).write_text(json.dumps(DATA))
    rows = [f"{time!r},{','.join(drawn[k % len(drawn)])}" for k, time in enumerate(times)]
    Path(trace).write_text("\n".join(["time_s,usb_degC,battery_degC", *rows]) + "\n")
    try:
        count = replay(model, trace, out, None, None)
    except Refused:
        return
    said = [line.split(",") for line in Path(out).read_text().splitlines()[1:]]
    assert len(said) == count == len(times)
    lost = False
    for (*values, status), (usb, battery) in zip(said, itertools.cycle(drawn)):
        trusted = all(cell and low <= float(cell) <= high for cell, low, high in ((usb, -20, 80), (battery, -20, 60)))
        lost = lost or not trusted
        assert (status in (TRACKING, WARMING_UP)) <= trusted
        assert trusted <= (status in ((TRACKING, WARMING_UP, DEGRADED) if lost else (TRACKING, WARMING_UP)))
        assert values[1:] == ["", "", ""] if status == FAULTED else all(math.isfinite(float(each)) for each in values)
