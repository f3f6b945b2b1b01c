"""What lies in the published files, tick after tick, for each way of reading them."""

import json
import os
import re

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_model.model import Input
from ambient_model.tracking import Estimate
from ambientd.publish.access import Access
from ambientd.publish.file import Options, RenamedFile
from ambientd.publish.file_in_place import InPlaceFile
from ambientd.publish.prometheus import PrometheusFile, exposition
from ambientd.publish.spec import Spec
from ambientd.publish.status import StatusFile
from ambientd.report import Report

INPUTS = (Input("usb", "degC", "usb-therm", -20, 90), Input("battery", "degC", "battery", -20, 70))


def report(ambient_degC, status="tracking", model="bench"):
    low, high = (None, None) if ambient_degC is None else (ambient_degC - 0.5, ambient_degC + 0.75)
    estimate = Estimate(ambient_degC, low, high, status, (30.0, 24.5))
    return Report(model, INPUTS, 90, 12.5, (30.0, None), estimate, 0.0 if status == "tracking" else None)


FAULTED = report(None, "faulted")


@pytest.fixture(params=[RenamedFile, InPlaceFile])
def kind(request):
    return request.param


@pytest.mark.parametrize(
    ("ambient_degC", "text"),
    [(23.4, "23400\n"), (-5.0006, "-5001\n"), (0.0, "0\n"), (-0.0001, "0\n"), (9.9996, "10000\n")],
)
def test_a_file_says_integer_millidegrees(kind, tmp_path, ambient_degC, text):
    publisher = kind(Spec("file", str(tmp_path / "temp")))
    publisher.publish(report(100.0))
    publisher.publish(report(ambient_degC))
    assert (tmp_path / "temp").read_text() == text
    publisher.close()
    assert os.listdir(tmp_path) == []


def test_what_is_not_trusted_is_removed_and_comes_back(kind, tmp_path):
    publisher = kind(Spec("file", str(tmp_path / "temp")))
    publisher.publish(report(23.4))
    publisher.publish(FAULTED)
    assert os.listdir(tmp_path) == []
    publisher.publish(FAULTED)
    publisher.publish(report(23.5))
    assert (tmp_path / "temp").read_text() == "23500\n"


def test_what_is_not_trusted_says_the_poison_from_the_first_tick(kind, tmp_path):
    publisher = kind(poisoned(tmp_path))
    publisher.publish(FAULTED)
    assert (tmp_path / "temp").read_text() == "-274000\n"
    publisher.publish(report(5.0))
    assert (tmp_path / "temp").read_text() == "5000\n"
    publisher.close()
    assert os.listdir(tmp_path) == []


def test_renamed_is_a_new_file_and_in_place_the_same(tmp_path):
    for kind, same in ((RenamedFile, False), (InPlaceFile, True)):
        publisher = kind(Spec("file", str(tmp_path / "temp")))
        publisher.publish(report(20.0))
        with open(tmp_path / "temp", "rb") as reader:
            publisher.publish(report(21.0))
            assert (reader.read() == b"21000\n") is same
        publisher.close()


def test_in_place_goes_on_with_a_file_that_is_there(tmp_path):
    (tmp_path / "temp").write_text("-1234567890\n")
    with open(tmp_path / "temp", "rb", buffering=0) as reader:
        publisher = InPlaceFile(poisoned(tmp_path, poison_millidegC=-40000))
        publisher.publish(report(7.0))
        assert os.pread(reader.fileno(), 15, 0) == b"7000\n"
        publisher.close()
        assert os.pread(reader.fileno(), 15, 0) == b"-40000\n"  # who keeps it open is not left with a last value


def test_status_is_one_json_object(tmp_path):
    publisher = StatusFile(Spec("status", str(tmp_path / "status.json")))
    publisher.publish(report(23.4))
    assert json.loads((tmp_path / "status.json").read_text()) == {
        "time_s": 12.5,
        "model": "bench",
        "status": "tracking",
        "ambient_degC": 23.4,
        "low_degC": 22.9,
        "high_degC": 24.15,
        "level_percent": 90,
        "age_s": 0.0,
        "sensors": {
            "usb": {"unit": "degC", "raw": 30.0, "used": 30.0},
            "battery": {"unit": "degC", "raw": None, "used": 24.5},
        },
    }
    publisher.publish(FAULTED)
    said = json.loads((tmp_path / "status.json").read_text())
    assert (said["status"], said["ambient_degC"], said["age_s"]) == ("faulted", None, None)
    publisher.close()
    assert os.listdir(tmp_path) == []


SAMPLE = re.compile(r'(ambientd_[a-z_]+)(?:\{((?:[a-z_]+="(?:[^"\\\n]|\\[\\"n])*",?)+)\})? (-?[0-9.e+-]+)')


def parsed(text):
    """The textfile as its format's grammar has it: HELP, TYPE, then samples of that name without timestamps."""
    samples, name = {}, None
    for line in text.splitlines():
        if line.startswith("# HELP "):
            name = line.split(" ")[2]
        elif line.startswith("# TYPE "):
            assert line == f"# TYPE {name} gauge"
        else:
            found = SAMPLE.fullmatch(line)
            assert found, line
            assert found[1] == name
            samples[name, found[2]] = float(found[3])
    return samples


def test_the_textfile_holds_the_gauges(tmp_path):
    publisher = PrometheusFile(Spec("prometheus", str(tmp_path / "ambientd.prom")))
    publisher.publish(report(23.4))
    samples = parsed((tmp_path / "ambientd.prom").read_text())
    assert samples["ambientd_ambient_celsius", 'model="bench"'] == 23.4
    assert samples["ambientd_ambient_low_celsius", 'model="bench"'] == 22.9
    assert samples["ambientd_status", 'status="tracking"'] == 1
    assert samples["ambientd_status", 'status="faulted"'] == 0
    assert samples["ambientd_sensor_used", 'sensor="battery",unit="degC"'] == 24.5
    assert ("ambientd_sensor_raw", 'sensor="battery",unit="degC"') not in samples
    publisher.close()
    assert os.listdir(tmp_path) == []


def test_a_gauge_without_a_value_is_left_out_whole():
    text = exposition(FAULTED)
    assert "ambientd_ambient_celsius" not in text
    assert "ambientd_estimate_age_seconds" not in text
    assert parsed(text)["ambientd_status", 'status="faulted"'] == 1


def test_labels_are_escaped():
    assert ("ambientd_ambient_celsius", r'model="a \"b\" \\ c"') in parsed(exposition(report(1.0, model='a "b" \\ c')))


def poisoned(tmp_path, **more):
    options = Options(**{"poison_millidegC": -274000, **more})
    return Spec("file", str(tmp_path / "temp"), options=options)


def test_at_exit_the_poison_may_stay(kind, tmp_path):
    publisher = kind(poisoned(tmp_path, at_exit="poison"))
    publisher.publish(report(23.4))
    with open(tmp_path / "temp", "rb", buffering=0) as reader:
        publisher.close()
        kept = os.pread(reader.fileno(), 15, 0)
    assert (tmp_path / "temp").read_text() == "-274000\n"
    assert kept == (b"-274000\n" if kind is InPlaceFile else b"23400\n")
    assert os.listdir(tmp_path) == ["temp"]


def test_a_daemon_that_never_published_leaves_the_poison_over_what_a_dead_one_left(kind, tmp_path):
    (tmp_path / "temp").write_text("1234567890\n")
    kind(poisoned(tmp_path, at_exit="poison")).close()
    assert (tmp_path / "temp").read_text() == "-274000\n"


def test_an_offset_is_added_to_the_value_and_not_to_the_poison(kind, tmp_path):
    publisher = kind(poisoned(tmp_path, offset_millidegC=100_000))
    publisher.publish(report(-5.0))
    assert (tmp_path / "temp").read_text() == "95000\n"
    publisher.publish(FAULTED)
    assert (tmp_path / "temp").read_text() == "-274000\n"
    publisher.close()


@settings(max_examples=60)
@example(value=999_999_999.5, offset=999_999)
@example(value=-999_999_999.5, offset=-999_999)
@given(value=st.floats(allow_nan=False), offset=st.integers(-999_999, 999_999))
@pytest.mark.parametrize("kind", [RenamedFile, InPlaceFile])
def test_with_an_offset_it_is_at_most_15_bytes_too(kind, value, offset, tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "temp"
    publisher = kind(Spec("file", str(path), options=Options(offset_millidegC=offset)))
    publisher.publish(report(value))
    if path.exists():
        assert re.fullmatch(rb"-?[0-9]+\n", path.read_bytes())
        assert len(path.read_bytes()) <= 15
        assert int(path.read_bytes()) == round(value * 1000) + offset
    publisher.close()


def test_a_value_that_cannot_be_replaced_is_poisoned_in_its_place(tmp_path):
    """As on a full disk, where there is no room for another file."""
    publisher = RenamedFile(poisoned(tmp_path))
    publisher.publish(report(20.0))
    (tmp_path / f"temp.{os.getpid()}.part").mkdir()
    with pytest.raises(OSError, match="Is a directory"):
        publisher.publish(report(21.0))
    assert (tmp_path / "temp").read_text() == "-274000\n"
    (tmp_path / f"temp.{os.getpid()}.part").rmdir()
    publisher.publish(report(21.0))
    assert (tmp_path / "temp").read_text() == "21000\n"


def test_in_place_a_shorter_value_is_never_followed_by_the_rest_of_a_longer_one(tmp_path, monkeypatch):
    publisher = InPlaceFile(poisoned(tmp_path))
    publisher.publish(FAULTED)
    seen = []
    cut = os.ftruncate
    monkeypatch.setattr(
        os, "ftruncate", lambda *arguments: (seen.append((tmp_path / "temp").read_bytes()), cut(*arguments))
    )
    publisher.publish(report(5.0))
    assert seen == [b"5000\n\n\n\n"]
    assert (tmp_path / "temp").read_bytes() == b"5000\n"


def test_in_place_a_longer_value_is_never_cut_at_the_length_of_a_shorter_one(tmp_path, monkeypatch):
    publisher = InPlaceFile(poisoned(tmp_path))
    publisher.publish(report(0.007))
    seen = []
    write = os.pwrite
    monkeypatch.setattr(
        os, "pwrite", lambda *arguments: (write(*arguments), seen.append((tmp_path / "temp").read_bytes()))
    )
    publisher.publish(report(23.4))
    assert seen == [b"7\n\n\n\n\n", b"23400\n"]


@pytest.mark.parametrize("by", ["remove", "rename", "folder"])
def test_in_place_who_kept_a_file_that_is_no_longer_there_reads_the_poison(tmp_path, by):
    folder = tmp_path / "out"
    folder.mkdir()
    publisher = InPlaceFile(poisoned(folder))
    publisher.publish(report(20.0))
    with open(folder / "temp", "rb", buffering=0) as reader:
        if by == "remove":
            (folder / "temp").unlink()
        elif by == "rename":
            (tmp_path / "new").write_text("1\n")
            (tmp_path / "new").rename(folder / "temp")
        else:
            folder.rename(tmp_path / "gone")
            folder.mkdir()
        publisher.publish(report(21.0))
        assert os.pread(reader.fileno(), 15, 0) == b"-274000\n"
    assert (folder / "temp").read_text() == "21000\n"
    publisher.close()


def test_a_file_that_cannot_be_given_away_is_not_there(kind, tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    (tmp_path / "temp").write_text("20000\n")
    monkeypatch.setattr(os, "chown", refuse)
    publisher = kind(Spec("file", str(tmp_path / "temp"), access=Access(owner=4711)))
    for _ in range(2):
        with pytest.raises(PermissionError):
            publisher.publish(report(21.0))
        assert os.listdir(tmp_path) == []
    monkeypatch.undo()
    publisher.adapt(Spec("file", str(tmp_path / "temp")))
    publisher.publish(report(21.0))
    assert (tmp_path / "temp").read_text() == "21000\n"
    publisher.close()


def test_another_poison_holds_from_the_next_value_on_and_the_file_stays_the_same(tmp_path):
    publisher = InPlaceFile(poisoned(tmp_path))
    publisher.publish(report(20.0))
    inode = (tmp_path / "temp").stat().st_ino
    publisher.adapt(poisoned(tmp_path, poison_millidegC=60000))
    assert (tmp_path / "temp").read_text() == "20000\n"
    publisher.publish(FAULTED)
    assert (tmp_path / "temp").read_text() == "60000\n"
    assert (tmp_path / "temp").stat().st_ino == inode
    publisher.close()
