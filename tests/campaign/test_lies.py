"""Sensors that answer, and not with the truth: stuck, jumping, out of range, or no number at all."""

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
