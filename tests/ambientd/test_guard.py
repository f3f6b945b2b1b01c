"""Secondary estimator and error variance in the daemon: what is published follows from the equations."""

import csv
import json
import math
import signal
from itertools import pairwise

import pytest

from ambient_model.codec import encode
from ambientd.fallback import FallbackTracker
from ambientd.state import decode

REST = (30.0, 25.0)
"""Main estimator and guard both say 23 degC."""
HEATED = (38.0, 25.0)
"""usb alone is heated: the main estimator says 23 + 8, less 0.8 of what its lag has taken in; the guard 23."""


def oracle(rows, period_s=1.0):
    """Estimate, sigma and the guard's weight by their equations, from rest at the first row."""
    a, b, c = (math.exp(-period_s / tau_s) for tau_s in (40, 10, 20))
    kept = {"slow": math.exp(-period_s / 60), "fast": math.exp(-period_s / 20), "guard": math.exp(-period_s / 30)}
    _, usb_lagged, battery_lagged = rows[0]
    guard_lagged = battery_lagged
    means, terms = {}, {}
    for _, usb, battery in rows:
        main, guard = usb + 0.8 * (battery_lagged - usb_lagged) - 3.0, guard_lagged - 2.0
        d = main - guard
        w = min(max(abs(d) - 1.0, 0.0), 1.0)
        y = main - w * d
        means = {name: kept[name] * means.get(name, y) + (1 - kept[name]) * y for name in ("slow", "fast")}
        z = {**{name: (y - mean) ** 2 for name, mean in means.items()}, "guard": min(abs(d), 1.0) ** 2}
        terms = {name: kept[name] * terms.get(name, z[name]) + (1 - kept[name]) * z[name] for name in z}
        yield y, math.sqrt(0.25 + terms["slow"] + 9 * terms["fast"] + 0.25 * terms["guard"]), w
        usb_lagged, battery_lagged = a * usb_lagged + (1 - a) * usb, b * battery_lagged + (1 - b) * battery
        guard_lagged = c * guard_lagged + (1 - c) * battery


@pytest.fixture
def heated():
    """Rest, then some minutes in which usb is heated slowly and let go, then rest again."""
    heat = [0.0] * 200 + [12 * math.sin(math.pi * k / 300) ** 2 for k in range(300)] + [0.0] * 200
    return [(float(k), 30.0 + each, 25.0 + 0.1 * math.sin(k / 30)) for k, each in enumerate(heat)]


@pytest.fixture
def tracker(make_model):
    return FallbackTracker(make_model(fallbacks=True, guarded=True), 1.0)


def feed(tracker, rows, start=0):
    return [tracker.update(float(start + k), row) for k, row in enumerate(rows)]


def width(estimate):
    return estimate.high_degC - estimate.low_degC


def test_a_replay_says_what_the_equations_say(ambientd, guarded_model_file, write_trace, heated, tmp_path):
    out = tmp_path / "out.csv"
    done = ambientd("replay", guarded_model_file, write_trace(heated), "-o", out)
    assert (done.returncode, done.stderr) == (0, "")
    with open(out, newline="") as stream:
        rows = list(csv.DictReader(stream))
    statuses = set()
    for row, (y, sigma, weight) in zip(rows, oracle(heated), strict=True):
        assert float(row["ambient_degC"]) == pytest.approx(y, abs=1e-9)
        assert float(row["low_degC"]) == pytest.approx(y - 1.5 * sigma, abs=1e-9)
        assert float(row["high_degC"]) == pytest.approx(y + 2.0 * sigma, abs=1e-9)
        assert (row["status"] == "degraded") == (weight > 0)
        statuses.add(row["status"])
    assert statuses == {"warming_up", "tracking", "degraded"}
    assert max(weight for _, _, weight in oracle(heated)) == 1


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


def test_a_restarted_daemon_goes_on_with_guard_and_spread(start, until, ended, guarded_model_file, phone, tmp_path):
    config, status = tmp_path / "config.json", tmp_path / "status"
    settings = {"model": guarded_model_file, "rate_hz": 20, "sysfs_root": str(phone.root), "state": {"path": "state"}}
    config.write_text(json.dumps({**settings, "publish": [f"status:{status}"]}))
    first = start("run", "--config", config)
    until(status.exists)
    began_s = json.loads(status.read_text())["time_s"]
    until(lambda: json.loads(status.read_text())["time_s"] > began_s + 0.2)
    assert ended(first, signal.SIGTERM)[0] == 0
    kept = decode((tmp_path / "state").read_bytes()).tracker
    assert kept.background.secondary[:3] == kept.snapshots[0][:3]
    assert kept.background.variance.means_degC == pytest.approx((23.0,) * 3)
    second = start("run", "--config", config)
    until(status.exists)
    assert f"ambientd: state {tmp_path}/state: continuing from " in ended(second)[2]


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


def test_with_two_inputs_away_it_coasts_as_wide_as_before_or_wider(tracker):
    feed(tracker, [REST] * 200)
    before = feed(tracker, [(30.0 + k / 10, 25.0) for k in range(20)], start=200)[-1]
    coasted = feed(tracker, [(None, None)] * 40, start=220)
    assert [each.status for each in coasted] == ["coasting"] * 30 + ["faulted"] * 10
    widths = [width(each) for each in [before, *coasted[:30]]]
    assert all(after >= wide - 1e-12 for wide, after in pairwise(widths))
    assert widths[0] > 3.5 * 0.5


def test_without_fallbacks_it_is_the_same(make_model, heated):
    alone = FallbackTracker(make_model(guarded=True), 1.0)
    with_fallbacks = FallbackTracker(make_model(fallbacks=True, guarded=True), 1.0)
    for time_s, *readings in heated:
        assert alone.update(time_s, readings) == with_fallbacks.update(time_s, readings)


@pytest.mark.parametrize("level", [50, 90, 98])
def test_the_interval_is_of_the_level_that_is_asked_for(make_model, level, heated):
    model = make_model(guarded=True)
    low, high = model.error_variance.quantiles[level]
    tracker = FallbackTracker(model, 1.0, level)
    for (time_s, *readings), (y, sigma, _) in zip(heated, oracle(heated)):
        estimate = tracker.update(time_s, readings)
        assert estimate[:3] == pytest.approx((y, y + low * sigma, y + high * sigma), abs=1e-9)


def test_a_guard_alone_leaves_the_constant_interval(make_model, heated):
    tracker = FallbackTracker(make_model(guarded=True)._replace(error_variance=None), 1.0)
    for (time_s, *readings), (y, _, _) in zip(heated, oracle(heated)):
        assert tracker.update(time_s, readings)[:3] == pytest.approx((y, y - 0.5, y + 0.75), abs=1e-9)


def test_a_spread_alone_widens_the_main_estimate(make_model):
    whole = make_model(guarded=True)
    model = whole._replace(
        secondary=None, error_variance=whole.error_variance._replace(terms=whole.error_variance.terms[1:2])
    )
    tracker = FallbackTracker(model, 1.0)
    feed(tracker, [REST] * 200)
    jumped = feed(tracker, [(32.0, 25.0)], start=200)[0]
    # 2 degC at once, less what a low-pass of 20 s follows; of the square it takes 1 - exp(-1 / 20), which weighs 9
    sigma = math.sqrt(0.25 + 9 * (1 - math.exp(-0.05)) * (2 * math.exp(-0.05)) ** 2)
    assert jumped[:4] == pytest.approx((25.0, 25.0 - 1.5 * sigma, 25.0 + 2.0 * sigma, "tracking"))


def test_the_guard_coasts_as_long_as_is_configured(make_model):
    tracker = FallbackTracker(make_model(guarded=True), 1.0, coast_s=100.0)
    feed(tracker, [REST] * 200 + [HEATED] * 5)
    said = feed(tracker, [(None, None)] * 100, start=205)
    assert {each.status for each in said} == {"coasting"}
    # for the main estimator usb stays hot; the guard, more than twice the threshold away at first, holds it
    assert said[0].ambient_degC == pytest.approx(23.0)
    assert max(abs(b.ambient_degC - a.ambient_degC) for a, b in pairwise(said)) < 0.5


def test_check_tells_of_guard_and_spread(ambientd, guarded_model_file):
    done = ambientd("check", "--model", guarded_model_file)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert (
        "interval     -0.75 to +1 degC around the estimate in steady state, 90 %; wider with movement, guard" in lines
    )
    assert "secondary    blended from 1 degC difference, alone from 2 degC" in lines
    assert "             passed: the secondary estimator keeps its equilibrium, and its periods agree" in lines


def test_check_tells_of_a_guard_that_contradicts_itself(ambientd, make_model, tmp_path):
    model = make_model(guarded=True)
    estimator = model.secondary.estimator
    wrong = estimator.discrete[1]._replace(A=((estimator.discrete[1].A[0][0] - 1e-3,),))
    discrete = (estimator.discrete[0], wrong, *estimator.discrete[2:])
    guard = model.secondary._replace(estimator=estimator._replace(discrete=discrete))
    path = tmp_path / "model.json"
    path.write_text(encode(model._replace(secondary=guard)))
    done = ambientd("check", "--model", path)
    assert (done.returncode, done.stderr) == (0, "")
    [warning] = [line for line in done.stdout.splitlines() if line.startswith("warning")]
    assert warning.startswith("warning      the secondary estimator contradicts itself by 0.00")
    assert warning.endswith(" (equilibrium moves, or periods disagree)")
