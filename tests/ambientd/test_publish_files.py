"""What lies in the published files, tick after tick, for each way of reading them."""

import itertools
import json
import os
import re
from unittest.mock import Mock

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_model.model import Input
from ambient_model.tracking import Estimate
from ambientd.json_text import json_text
from ambientd.publish import prometheus, status
from ambientd.publish.access import Access
from ambientd.publish.file import Options, RenamedFile
from ambientd.publish.file_in_place import InPlaceFile
from ambientd.publish.prometheus import exposition
from ambientd.publish.spec import Spec
from ambientd.report import Report

INPUTS = (Input("usb", "degC", "usb-therm", -20, 90), Input("battery", "degC", "battery", -20, 70))
POISON = "-274000\n"
KINDS = [RenamedFile, InPlaceFile]


def report(ambient_degC, status="tracking", model="bench"):
    low, high = (None, None) if ambient_degC is None else (ambient_degC - 0.5, ambient_degC + 0.75)
    estimate = Estimate(ambient_degC, low, high, status, (30.0, 24.5))
    return Report(model, INPUTS, 90, 12.5, (30.0, None), estimate, 0.0 if status == "tracking" else None)


FAULTED = report(None, "faulted")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "temp"


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


def spec(path, **options):
    return Spec("file", str(path), options=Options(**options) if options else None)


def poisoned(path, **options):
    return spec(path, **{"poison_millidegC": -274000, **options})


@settings(max_examples=60)
@example(value=999_999_999.5, offset=999_999)
@example(value=-999_999_999.5, offset=-999_999)
@example(value=-0.0001, offset=0)
@example(value=9.9996, offset=0)
@given(value=st.floats(allow_nan=False) | st.floats(-60, 90), offset=st.just(0) | st.integers(-999_999, 999_999))
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_is_one_whole_line_of_at_most_15_bytes_or_absent(kind, value, offset, tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "temp"
    publisher = kind(spec(path, offset_millidegC=offset))
    publisher.publish(report(100.0))
    publisher.publish(report(value))
    if path.exists():
        assert path.read_bytes() == b"%d\n" % (round(value * 1000) + offset)
        assert len(path.read_bytes()) <= 15
    else:
        assert abs(value) >= 10**9 - 1
    publisher.close()
    assert os.listdir(path.parent) == []


def test_what_is_not_trusted_is_removed_or_poisoned_from_the_first_tick(kind, path):
    for made, content in ((spec(path), None), (poisoned(path, offset_millidegC=100_000), POISON)):
        publisher = kind(made)
        for each in (FAULTED, report(-5.0), FAULTED, FAULTED):
            publisher.publish(each)
            # the offset is added to the value, and not to the poison
            wanted = content if each is FAULTED else "-5000\n" if content is None else "95000\n"
            assert (path.read_text() if path.exists() else None) == wanted
        publisher.close()
        assert os.listdir(path.parent) == []


def test_status_is_one_json_object(path):
    publisher = status.publisher(Spec("status", str(path)), None)
    publisher.publish(report(23.4))
    assert json.loads(path.read_text()) == {
        "time_s": 12.5,
        "model": "bench",
        "status": "tracking",
        "ambient_degC": 23.4,
        "low_degC": 22.9,
        "high_degC": 24.15,
        "level_percent": 90,
        "age_s": 0.0,
        "missed_ticks": 0,
        "clock_steps_back": 0,
        "sensors": {
            "usb": {"unit": "degC", "raw": 30.0, "used": 30.0},
            "battery": {"unit": "degC", "raw": None, "used": 24.5},
        },
    }
    publisher.publish(FAULTED)
    said = json.loads(path.read_text())
    assert (said["status"], said["ambient_degC"], said["age_s"]) == ("faulted", None, None)
    publisher.close()
    assert os.listdir(path.parent) == []


def test_the_textfile_holds_the_gauges(path):
    """That it is what the format wants is for the real node_exporter to say, which is beside the unit's tests."""
    publisher = prometheus.publisher(Spec("prometheus", str(path)), None)
    publisher.publish(report(23.4))
    lines = path.read_text().splitlines()
    for line in (
        'ambientd_ambient_celsius{model="bench"} 23.4',
        'ambientd_ambient_low_celsius{model="bench"} 22.9',
        'ambientd_status{status="tracking"} 1.0',
        'ambientd_status{status="faulted"} 0.0',
        'ambientd_sensor_used{sensor="battery",unit="degC"} 24.5',
    ):
        assert line in lines
    assert 'ambientd_sensor_raw{sensor="battery"' not in path.read_text()
    publisher.close()
    assert os.listdir(path.parent) == []
    text = exposition(FAULTED)
    assert not re.search("ambientd_(ambient_celsius|estimate_age_seconds)", text), "a gauge without a value is left out"
    assert 'ambientd_status{status="faulted"} 1.0\n' in text
    assert r'ambientd_ambient_celsius{model="a \"b\" \\ c"} 1.0' in exposition(report(1.0, model='a "b" \\ c'))


def test_at_exit_the_poison_may_stay_over_what_a_dead_daemon_left_too(kind, path):
    publisher = kind(poisoned(path, at_exit="poison"))
    publisher.publish(report(23.4))
    with open(path, "rb", buffering=0) as reader:
        publisher.close()
        kept = os.pread(reader.fileno(), 15, 0)
    assert path.read_text() == POISON
    assert kept == (b"-274000\n" if kind is InPlaceFile else b"23400\n")
    path.write_text("1234567890\n")
    kind(poisoned(path, at_exit="poison")).close()  # it has never published
    assert path.read_text() == POISON
    assert os.listdir(path.parent) == ["temp"]


def test_in_place_no_reader_ever_sees_the_rest_of_another_value(path, monkeypatch):
    publisher = InPlaceFile(poisoned(path))
    publisher.publish(FAULTED)
    seen = []
    write, cut = os.pwrite, os.ftruncate
    monkeypatch.setattr(os, "pwrite", lambda *each: (write(*each), seen.append(path.read_bytes())))
    monkeypatch.setattr(os, "ftruncate", lambda *each: (cut(*each), seen.append(path.read_bytes())))
    for ambient_degC in (5.0, 0.007, 23.4):
        publisher.publish(report(ambient_degC))
    assert seen == [b"5000\n\n\n\n", b"5000\n", b"7\n\n\n\n", b"7\n", b"7\n\n\n\n\n", b"23400\n"]


OTHERS = itertools.product(KINDS, ["symlink", "hard link", "another user"])


@pytest.mark.parametrize(("kind", "by"), [(RenamedFile, "nobody"), *OTHERS])
def test_a_value_that_cannot_be_replaced_does_not_stay_and_no_other_file_is_written_into(kind, path, by):
    """As on a full disk, where there is no room for another file."""
    theirs = path.with_name("theirs")
    theirs.write_text("20000\n")
    if by == "another user" and os.getuid() != 0:
        pytest.skip("only root gives files to others")
    if by == "symlink":
        path.symlink_to(theirs)
    elif by == "hard link":
        os.link(theirs, path)
    else:
        path.write_text("20000\n")
        os.chown(path, 4711 if by == "another user" else -1, -1)
    publisher = kind(poisoned(path))
    in_the_way = path.with_name(f"temp.{os.getpid()}.part")
    in_the_way.mkdir()
    with pytest.raises(OSError, match="Is a directory"):
        publisher.publish(report(21.0))
    assert (path.read_text() if path.exists() else None) == (POISON if by == "nobody" else None)
    in_the_way.rmdir()
    publisher.publish(report(21.0))
    assert path.read_text() == "21000\n"
    assert (path.is_symlink(), path.stat().st_uid, path.stat().st_nlink) == (False, os.getuid(), 1)
    assert theirs.read_text() == "20000\n"


@pytest.mark.parametrize("by", ["remove", "rename"])
def test_in_place_a_reader_of_a_file_that_is_no_longer_there_reads_the_poison(path, tmp_path, by):
    publisher = InPlaceFile(poisoned(path))
    publisher.publish(report(20.0))
    with open(path, "rb", buffering=0) as reader:
        if by == "remove":
            path.unlink()
        else:
            (tmp_path / "new").write_text("1\n")
            (tmp_path / "new").rename(path)
        publisher.publish(report(21.0))
        assert os.pread(reader.fileno(), 15, 0) == b"-274000\n"
    assert path.read_text() == "21000\n"
    publisher.close()


def test_a_file_that_cannot_be_given_away_is_not_there(kind, path, monkeypatch):
    path.write_text("20000\n")
    monkeypatch.setattr(os, "chown", Mock(side_effect=PermissionError(1, "Operation not permitted")))
    publisher = kind(spec(path)._replace(access=Access(owner=4711)))
    for _ in range(2):
        with pytest.raises(PermissionError):
            publisher.publish(report(21.0))
        assert os.listdir(path.parent) == []
    monkeypatch.undo()
    publisher.adapt(spec(path))
    publisher.publish(report(21.0))
    assert path.read_text() == "21000\n"
    publisher.close()


def test_another_poison_holds_from_the_next_value_on_and_the_file_stays_the_same(path):
    publisher = InPlaceFile(poisoned(path))
    publisher.publish(report(20.0))
    inode = path.stat().st_ino
    publisher.adapt(poisoned(path, poison_millidegC=60000))
    assert path.read_text() == "20000\n"
    publisher.publish(FAULTED)
    assert path.read_text() == "60000\n"
    assert path.stat().st_ino == inode
    publisher.close()


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.lists(inner).map(tuple) | st.dictionaries(st.text(), inner),
)


@given(VALUES)
def test_text_without_json_is_what_json_writes(value):
    assert json_text(value) == json.dumps(value)
