import pytest

from ambient_trainer.data.probe_offsets import load_offsets
from ambient_trainer.data.trace import load_trace
from ambient_trainer.evaluation.bath import Settled
from ambient_trainer.laboratory.calibration import bath
from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.messages import NoResponse
from refusals import refused


@pytest.fixture
def instruments():
    """A simulated thermometer and probes in a bath of 20 degC, 200 times as fast."""
    kinds = (settings("greisinger-easybus", port=""), settings("agilent-34970a", port="", probes={"a": 101, "b": 102}))
    with bath(*kinds, 2.0, 400.0, speed=200.0, room_degC=20.0) as made:
        yield made


def test_a_thermometer_that_never_answers_ends_it_with_its_own_error(instruments):
    instruments.thermometer.read = lambda: (_ for _ in ()).throw(NoResponse("thermometer", "port", "a", "b"))
    instruments.patience_s, shown = 1e6, []
    with pytest.raises(NoResponse):
        instruments.until_settled(Settled(window_s=60.0), shown.append)
    assert any("thermometer on port" in text for text in shown)


def test_patience_ends(instruments):
    read = instruments.multiplexer.read
    instruments.multiplexer.read = lambda: read()._replace(values={})
    faults = refused(instruments.until_settled, Settled(), str).faults
    assert [fault.problem.split(" has ")[0] for fault in faults] == ["a", "b"]


def test_the_simulated_bath_is_recorded_and_gives_the_same_offsets_again_or_none_where_it_is_not_settled(
    trainer, tmp_path
):
    output, again, record = (str(tmp_path / name) for name in ("offsets.yaml", "again.yaml", "bath.csv"))
    status, printed, said = trainer("calibrate", "--simulate", "--window", 120, "-o", output, "--record", record)
    assert status == 0, said
    assert "the worst offset misses its by 0.0" in printed
    assert "it lasts 0 s of 120 s" in printed + said, "without a terminal, too, it says what it waits for"
    assert list(load_trace(record).columns) == ["bath_degC", "air1_degC", "air2_degC", "air3_degC", "air4_degC"]
    assert trainer("calibrate", record, "--window", 120, "-o", again)[0] == 0
    first, second = ({name: each.at(0.0) for name, each in load_offsets(path).items()} for path in (output, again))
    assert first == pytest.approx(second, abs=0.02)
    unsettled = tmp_path / "unsettled.yaml"
    assert trainer("calibrate", record, "-o", unsettled, "--window", 90000)[0] == 1
    assert not unsettled.exists()
