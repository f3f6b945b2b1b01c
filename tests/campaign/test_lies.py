"""Sensors that answer, and not with the truth: stuck, jumping, out of range, or no number at all."""

import math
from pathlib import Path

import pytest

from ambient_model.codec import encode
from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model

RULES = {"stuck_after_s": 120, "stuck_within_K": 0.1, "jump_K_per_s": 5}


def test_a_stuck_sensor_is_done_without_until_it_moves(start, zones):
    daemon = start(supervision=RULES)
    reports = []
    for k in range(200):
        for kind in ("battery", "cpu-0-0"):
            zones.say(kind, 30000 + 40 * k)
        reports.append(daemon.step())
    statuses = [each["status"] for each in reports]
    assert statuses.index("degraded") in range(119, 123)
    assert set(statuses[125:]) == {"degraded"}
    assert reports[-1]["sensors"]["usb"] == {"unit": "degC", "raw": None, "used": None}
    zones.say("usb-therm", 31000)
    back = daemon.step()
    # it is read again; the fallback without it speaks until the main estimator has settled
    assert (back["status"], back["sensors"]["usb"]) == ("degraded", {"unit": "degC", "raw": 31.0, "used": None})
    assert daemon.end() == [
        "ambientd: sensor usb: set aside (stands at 30 degC while others move)",
        "ambientd: sensor usb: is back",
    ]


def test_a_jump_reaches_no_consumer(start, zones):
    """It leaps by 40 K and back ten times: the published value never follows."""
    daemon = start(supervision=RULES)
    daemon.steps(40)
    seen = []
    for k in range(10):
        zones.say("usb-therm", 70000)
        seen += daemon.steps(3 + k % 6)
        zones.say("usb-therm", 30000)
        seen += daemon.steps(25)
    ambient = [each["ambient_degC"] for each in seen]
    assert max(abs(each - 28.0) for each in ambient) < 1.0  # 36 K if it were believed
    assert {each["status"] for each in seen} == {"degraded", "tracking"}
    assert seen[-1]["sensors"]["usb"]["used"] == 30.0
    assert len(daemon.end()) <= 12


TRACE = Path(__file__).parents[3] / "shared" / "measured" / "s25plus-zones" / "s25_zones_tidy.csv"
PHONE_ZONES = ("battery", "chassis", "modem", "ambient")


def phone_model():
    """The chassis, less what the modem adds to it: a model that would believe the AMBIENT zone if it were let."""
    inputs = tuple(Input(name, "degC", name.upper(), -40.0, 120.0) for name in PHONE_ZONES)

    def estimator(inputs, direct):
        discrete = (Discrete(1.0, (), (), ((),), (direct,)),)
        return Estimator(inputs, (), discrete, 0.0, (), {level: (-level / 50, level / 50) for level in (50, 90, 98)})

    main = estimator(inputs, (0.1, 0.1, -0.2, 1.0))
    others = {"ambient": estimator(inputs[:3], (0.2, 1.0, -0.2))}
    steps = tuple((20.0 + k, 21.0, 22.0, 23.0) for k in range(5))
    return Model("phone", "2024-05-01", "ambient_degC", main, others, {}, conformance_of(main, steps))


def follow_phone(start, zones, tmp_path, first, last):
    """Rows of the measured trace through the fake sysfs, each when it was measured; what was published."""
    if not TRACE.exists():
        pytest.skip(f"no {TRACE}: the measured zones are not part of the repository")
    for folder in list(zones.folder.iterdir()):
        folder.rename(tmp_path / folder.name)
    for number, name in enumerate(PHONE_ZONES):
        zones.add(number, name.upper(), 25000)
    model = tmp_path / "phone.json"
    model.write_text(encode(phone_model()))
    with open(TRACE) as stream:
        columns = next(stream).strip().split(",")
        places = [columns.index(f"T_{name}") for name in PHONE_ZONES]
        rows = [line.split(",") for line in stream][first:last]
    daemon, seen, start_s = None, [], float(rows[0][0])
    for row in rows:
        for name, place in zip(PHONE_ZONES, places):
            if row[place]:  # what was not logged stays as it was
                zones.say(name.upper(), round(float(row[place]) * 1000))
        if daemon is None:
            daemon = start(model=str(model), supervision={"stuck_after_s": 1800, "stuck_within_K": 0.1})
            begun_s = daemon.clock.now_s
        seen.append(daemon.step(begun_s + math.floor(4 * (float(row[0]) - start_s)) / 4 + 1 - daemon.clock.now_s))
    return daemon, seen


def believed(seen):
    return [each["sensors"]["ambient"]["used"] is not None for each in seen]


@pytest.mark.slow
def test_it_stays_rejected_through_the_cold(start, zones, tmp_path):
    """All 17 hours: also where the phone lies in the cold, at 2 degC, and after the 30 hours between its two runs."""
    daemon, seen = follow_phone(start, zones, tmp_path, 0, None)
    first = believed(seen).index(False)
    assert not any(believed(seen)[first:])
    rejected = seen[first:]
    assert min(each["ambient_degC"] for each in rejected if each["ambient_degC"] is not None) < 10.0
    assert [line.split(" (")[0] for line in daemon.log] == ["ambientd: sensor ambient: set aside"]
