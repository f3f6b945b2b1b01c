"""Secondary estimator and error variance in the daemon: what is published follows from the equations."""

import json
import signal

import pytest

from ambientd.fallback import FallbackTracker

REST = (30.0, 25.0)
"""Main estimator and guard both say 23 degC."""
HEATED = (38.0, 25.0)
"""usb alone is heated: the main estimator says 23 + 8, less 0.8 of what its lag has taken in; the guard 23."""


@pytest.fixture
def tracker(make_model):
    return FallbackTracker(make_model(fallbacks=True, guarded=True), 1.0)


def feed(tracker, rows, start=0):
    return [tracker.update(float(start + k), row) for k, row in enumerate(rows)]


def test_a_degraded_estimate_is_published_as_any_other(start, until, ended, guarded_model_file, phone, tmp_path):
    """Both sensors at rest, then usb jumps: two recursions disagree, and who listens is told so."""
    status = tmp_path / "status"
    kinds = ("--publish", f"status:{status}", "--publish", f"file:{tmp_path}/temp")
    daemon = start("run", "--model", guarded_model_file, "--sysfs-root", phone.root, "--rate", "20", *kinds)

    def said():
        return json.loads(status.read_text()) if status.exists() else {}

    until(lambda: said().get("ambient_degC") == pytest.approx(23.0))
    calm = said()
    assert calm["high_degC"] - calm["low_degC"] == pytest.approx(3.5 * 0.5)
    usb = phone.root / "class/thermal/thermal_zone10/temp"
    usb.write_text("60000\n")
    until(lambda: said().get("sensors", {}).get("usb", {}).get("used") == 60.0)
    wide = said()
    assert wide["ambient_degC"] == pytest.approx(23.0, abs=0.01)  # 30 degC apart: the guard's word alone
    assert wide["high_degC"] - wide["low_degC"] > 3.5 * 0.5
    assert (calm["status"], wide["status"]) == ("warming_up", "degraded")
    assert ended(daemon, signal.SIGTERM)[0] == 0


def test_a_lost_input_takes_the_fallback_over_from_the_guarded_estimate(tracker):
    feed(tracker, [REST] * 200)
    guarded = feed(tracker, [HEATED] * 5, start=200)[-1]
    assert guarded.status == "degraded"
    assert guarded.ambient_degC == pytest.approx(23.0)
    lost = feed(tracker, [(None, 25.0)] * 3, start=205)
    assert [each.status for each in lost] == ["degraded"] * 3
    assert lost[0].ambient_degC == pytest.approx(guarded.ambient_degC, abs=1e-9)
    # the fallback's own -2 to 2 around 20 and around what was said last: no spread
    assert (lost[0].low_degC, lost[0].high_degC) == pytest.approx((18.0, 25.0))
    back = feed(tracker, [HEATED], start=208)[0]
    assert back.ambient_degC == pytest.approx(lost[-1].ambient_degC, abs=1e-9)
