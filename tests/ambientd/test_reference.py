"""References of the ambient: hostile files, what counts and when, and a real daemon that is told, killed and told."""

import json
import math
import os
import signal

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ambient_model.conformance import conformance_of
from ambient_model.model import ReadingModel, SensorLimits
from ambient_model.tracking import TRACKING, WARMING_UP, Estimate
from ambientd.fallback import FallbackState, FallbackTracker
from ambientd.publish.prometheus import exposition
from ambientd.reference import OffsetLearner, submission_path
from ambientd.report import Report
from ambientd.service import Service
from ambientd.settings import ReferenceSpec
from ambientd.sources.quantities import reference_degC
from ambientd.state import State, decode, encode

AT_REST = Estimate(21.0, 20.5, 21.5, TRACKING, (25.0,))
DAY_S = 86400.0


@given(st.binary(max_size=80), st.sampled_from(["degC", "millidegC"]))
@example(b"nan", "degC")
@example(b"21.5 inf", "degC")
@example(b"1e999", "degC")
@example(b"21.5 0", "degC")
@example(b"2_1", "degC")
@example(b"--5", "degC")
def test_a_reference_files_bytes_are_a_sane_reading_or_refused(content, unit):
    try:
        value, sigma = reference_degC(content, unit, 0.5)
    except ValueError:
        pass
    else:
        assert -90 <= value <= 100
        assert 0.05 <= sigma <= 20


@pytest.mark.parametrize(
    ("content", "unit", "reading"),
    [
        (b"21.5\n", "degC", (21.5, 0.7)),
        (b" -3 1.5", "degC", (-3.0, 1.5)),
        (b"21500 400\n", "millidegC", (21.5, 0.4)),
        (b"21.5 0.0001", "degC", (21.5, 0.05)),
    ],
)
def test_a_reference_file_is_read_in_its_unit(content, unit, reading):
    assert reference_degC(content, unit, 0.7) == reading


class Device:
    """A learner with clocks of its own."""

    def __init__(self, folder, **values):
        self.now_s, self.unix_s, self.notes = 100.0, 1.7e9, []
        self.file, self.state = folder / "room", str(folder / "state")
        spec = ReferenceSpec(path=str(self.file), **values)
        self.learner = OffsetLearner(spec, 90, self.state, self.notes.append, lambda: self.unix_s)

    def write(self, content, age_s=0.0, path=None):
        path = path or self.file
        path.write_bytes(content)
        os.utime(path, (self.unix_s - age_s,) * 2)

    def tick(self, passed_s=1.0, estimate=AT_REST):
        self.now_s, self.unix_s = self.now_s + passed_s, self.unix_s + passed_s
        shown = self.learner.update(self.now_s, estimate)
        offset = self.learner.report.offset_degC
        assert shown.ambient_degC == estimate.ambient_degC + offset
        return offset


@pytest.fixture
def device(tmp_path):
    return Device(tmp_path)


def test_a_reading_counts_once_and_the_next_one_a_correlation_time_later(device):
    device.write(b"21.5 0.5\n")
    first = device.tick()
    R = 0.25 + (0.5 / 1.645) ** 2
    assert first == pytest.approx(0.5 * 0.25 / (0.25 + R))
    assert device.learner.report.last.counted
    assert "counted" in device.notes[0]
    device.tick()
    device.write(b"21.5 0.5\n")
    assert device.tick(600) < first, "it is forgotten slowly, and not counted again"
    device.write(b"21.5 0.5\n", age_s=-3001)
    device.unix_s += 3001
    assert device.tick() > first
    assert len(device.notes) == 2


WILD = (b"31.0", b"11.0 0.5", b"31.0 20", b"", b"nan", b"\x00" * 5000, b"21500")


@pytest.mark.parametrize(("content", "age_s"), [(b"21.5", 3601), (b"21.5", -3600), *((each, 0) for each in WILD)])
def test_a_wild_stale_or_damaged_reading_moves_nothing(device, content, age_s):
    for _ in range(20):
        device.write(content, age_s)
        assert device.tick() == 0
    assert not device.learner.report.last.counted
    assert len(device.notes) == 1, "it is logged once"


def test_nothing_counts_while_it_warms_up_and_the_file_counts_afterwards(device):
    device.write(b"21.5")
    assert device.tick(estimate=AT_REST._replace(status=WARMING_UP)) == 0
    assert device.learner.report.last is None
    assert device.tick() > 0


def test_a_folder_a_pipe_and_no_file_are_no_reference(device):
    assert device.tick() == 0
    os.mkfifo(device.file)
    os.utime(device.file, (device.unix_s,) * 2)
    assert device.tick() == 0
    assert not device.learner.report.last.counted


def test_it_outlives_a_restart_and_is_forgotten_by_the_calendar(device, tmp_path):
    device.write(b"21.5 0.5\n")
    learnt = device.tick()
    tracker = FallbackState((None,), 0, 0.0, None, 0.0)
    state = State("model", "boot", device.now_s, tracker, device.learner.memory(device.now_s))
    assert decode(encode(state)) == state
    assert decode(encode(state._replace(offset=None))).offset is None
    after = Device(tmp_path)
    after.now_s, after.unix_s = 5.0, device.unix_s + 7 * DAY_S
    after.learner.restore(decode(encode(state)).offset, after.now_s)
    assert after.tick() == pytest.approx(learnt * math.exp(-7 / 28), rel=1e-5)
    assert after.learner.report.last == device.learner.report.last


def test_a_told_reading_is_answered_and_removed_once_it_is_saved(device, tmp_path):
    told = tmp_path / "state.tell"
    assert str(told) == submission_path(device.state)
    device.write(b"21.5 0.5", path=told)
    device.tick(estimate=AT_REST._replace(status=WARMING_UP))
    assert device.learner.unsaved
    assert told.exists()
    assert WARMING_UP in device.learner.memory(device.now_s).last.outcome
    device.learner.saved()
    assert not told.exists()


class Pair(Device):
    """Two sensors of one temperature, each expected where the other is."""

    def __init__(self, folder, make_model):
        super().__init__(folder)
        # readings and low-pass filters follow one temperature of 10 degC's deviation, each with noise of 0.1
        precision = tuple(tuple(100.0 * (i == j) - 24.99937502 for j in range(4)) for i in range(4))
        limits = SensorLimits(0.1, 9.0, 9.0, 9.0, 1e6, 60.0, 0.2)
        about = (60.0,), (25.0,) * 4, precision, (limits,) * 2, 1.0, 0.0, (-20.0, 70.0), 5.0, ()
        readings = ReadingModel(*about, ((0.25, -0.25), (-0.25, 0.25)), 0.2)
        self.tracker = FallbackTracker(make_model()._replace(readings=readings, fallbacks={}), 1.0)
        self.learner.learn_sensors(readings, self.tracker.validation)
        self.service = Service(make_model(), 90, self.tracker, lambda report: None, self.learner)

    def ticks(self, count, *readings):
        for _ in range(count):
            self.now_s, self.unix_s = self.now_s + 1, self.unix_s + 1
            shown = self.service.tick((self.now_s, [*readings]))
        return shown

    def told(self, *readings, passed_s=8 * 3600):
        before = self.ticks(1500, *readings)
        self.write(b"22 20")  # so unsure that it says nothing itself
        return before, self.ticks(1, *readings), self.ticks(passed_s, *readings)


def test_sensors_own_errors_are_learnt_from_their_differences_when_a_reading_counts(tmp_path, make_model):
    device, own = Pair(tmp_path, make_model), 0.3 * (1 - math.exp(-1500 / 600))
    before, at_once, later = device.told(25.3, 24.7)
    assert device.learner.report.std_degC == pytest.approx(0.2, rel=1e-2)
    assert before.used == at_once.used == (25.3, 24.7)
    # gains of 0.2 and 0.8 at rest
    assert at_once.ambient_degC - before.ambient_degC == pytest.approx(0.6 * own, abs=2e-3)
    assert later.used == pytest.approx((25.3 - own, 24.7 + own), abs=2e-3)
    assert later.ambient_degC == pytest.approx(at_once.ambient_degC, abs=2e-3), "over hours, without a step"
    memory, after = device.learner.memory(device.now_s), Pair(tmp_path, make_model)
    state = State("model", "boot", device.now_s, FallbackState((None,), 0, 0.0, None, 0.0), memory)
    assert decode(encode(state)) == state
    after.learner.restore(memory, after.now_s)
    assert after.learner.corrected([25.3, 85.0]) == pytest.approx([25.3 - own, 85.0], abs=2e-3)
    half, after = Pair(tmp_path, make_model), Pair(tmp_path, make_model)
    half.file.unlink()
    half.told(25.3, 24.7, passed_s=1800)
    after.learner.restore(half.learner.memory(half.now_s), half.now_s)
    assert after.learner.corrected([25.3, 24.7]) == pytest.approx(half.learner.corrected([25.3, 24.7]), abs=2e-3)
    heat = Pair(tmp_path, make_model)
    heat.file.unlink()
    heat.told(28.0, 24.0, passed_s=1)
    assert heat.learner.memory(heat.now_s).sensors_degC == (0.0, 0.0), "no sensor is off by so much"


def test_a_scraper_is_shown_it(device, make_model):
    inputs = make_model().main.inputs
    about = ("bench", inputs, 90, 1.0, (1.0, 2.0), AT_REST._replace(used=(1.0, 2.0)), 0.0, 0, 0)
    device.write(b"21.5")
    device.tick()
    assert "ambientd_offset_celsius 0." in exposition(Report(*about, device.learner.report))
    assert "ambientd_offset" not in exposition(Report(*about))


@pytest.fixture
def config(make_model, saved, configure):
    """A configuration with a model that has settled after a few ticks."""
    model = make_model()
    quick = tuple(each._replace(A=((0.0, 0.0),) * 2, B=((1.0, 0.0), (0.0, 1.0))) for each in model.main.discrete)
    main = model.main._replace(discrete=quick)
    path = saved(model._replace(main=main, conformance=conformance_of(main, model.conformance.inputs)))
    return lambda **keys: configure(model=path, publish=["status:status"], **keys)


LEARNS = {"state": {"path": "state.json", "max_age_s": 3600}, "reference": {}}


@pytest.mark.parametrize("more", [{}, {"state": {"path": "state.json"}}, LEARNS])
def test_telling_without_a_daemon_that_learns_says_what_to_do(ambientd, config, more):
    done = ambientd("tell", "21.5", "--sigma", "0.5", "--config", config(**more), status=1)
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert ("no daemon runs" if "reference" in more else "reference: {}") in done.stderr


def test_a_reference_without_a_state_is_refused_with_every_fault(ambientd, config):
    done = ambientd("check", "--config", config(reference={"unit": "K", "max_age_s": 0, "colour": 1}), status=1)
    for place in ("reference: needs 'state'", "reference.unit", "reference.max_age_s", "reference.colour"):
        assert place in done.stderr


@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGTERM])
def test_a_daemon_is_told_and_remembers_it_over_its_end(start, until, ended, ambientd, config, status, tmp_path, by):
    path = config(**LEARNS)
    daemon = start("run", "--config", path)
    until(lambda: status().get("status") == TRACKING)
    assert ambientd("tell", "23.5", "--sigma", "0.5", "--config", path).stderr == ""
    offset = status()["offset_degC"]
    assert 0.1 < offset < 0.4
    assert status()["last_reference"]["degC"] == 23.5
    assert status()["ambient_degC"] == pytest.approx(23 + offset, abs=1e-6)
    for value, why in (("23.5", "counted"), ("33", "counted")):
        assert why in ambientd("tell", value, "--config", path, status=1).stderr
    ended(daemon, by)
    (tmp_path / "status").unlink(missing_ok=True)
    assert json.loads((tmp_path / "state.json").read_text().splitlines()[0])["offset"]["last"]["degC"] == 33
    start("run", "--config", path)
    until(status)
    assert status()["offset_degC"] == pytest.approx(offset, abs=1e-3)
    assert not (tmp_path / "state.json.tell").exists()


@pytest.mark.parametrize(
    ("content", "status", "fact"),
    [(None, 0, "not there"), ("21.5 0.7\n", 0, "21.5 +- 0.7 degC"), ("warm", 1, "VALUE SIGMA")],
)
def test_check_shows_what_the_reference_holds(ambientd, config, tmp_path, content, status, fact):
    room = tmp_path / "room"
    if content is not None:
        room.write_text(content)
    written = config(state={"path": "state.json"}, reference={"path": str(room)})
    done = ambientd("check", "--config", written, status=status)
    assert fact in next(line for line in (done.stdout + done.stderr).splitlines() if str(room) in line)
