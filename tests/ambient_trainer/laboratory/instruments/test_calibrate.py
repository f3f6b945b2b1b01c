from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import lfilter

from ambient_model.faults import Refused
from ambient_trainer.cli.commands.calibrate import command
from ambient_trainer.data.trace import Trace, load_trace, save_trace
from ambient_trainer.laboratory.clock import FastClock
from ambient_trainer.laboratory.instruments.bath_run import BathLab, BathRun, Pace
from ambient_trainer.laboratory.instruments.calibration import (
    Bath,
    Settled,
    calibrated,
    settled_windows,
    unsettled,
)
from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer
from ambient_trainer.laboratory.instruments.offsets import load_offsets
from ambient_trainer.laboratory.instruments.thermometer import Thermometer
from ambient_trainer.laboratory.line import SwitchedOff
from ambient_trainer.laboratory.simulated.multiplexer import SimulatedMultiplexer
from ambient_trainer.laboratory.simulated.thermometer import SimulatedThermometer

PERIOD_S = 2.0


def bath(reference_degC, offsets_K, noise_K=0.02, seed=0) -> Bath:
    """What probes that lack these offsets read in a bath of this temperature, once in two seconds."""
    random = np.random.default_rng(seed)
    reference_degC = np.asarray(reference_degC, dtype=float)
    count = len(reference_degC)
    probes = {
        name: reference_degC - offset_K + noise_K * random.standard_normal(count)
        for name, offset_K in offsets_K.items()
    }
    return Bath(PERIOD_S * np.arange(count), reference_degC, probes)


def test_an_offset_is_the_mean_difference_and_its_error_that_of_a_mean() -> None:
    window = bath(np.full(151, 20.0), {"a": 0.3, "b": -1.0})
    tables = calibrated([window], "bath")
    (point,) = tables["a"].points
    more_K = 20.0 - window.probes_degC["a"]
    assert point.offset_K == pytest.approx(more_K.mean())
    assert point.reading_degC == pytest.approx(window.probes_degC["a"].mean())
    assert point.standard_error_K == pytest.approx(0.02 / np.sqrt(151), rel=0.5)
    assert tables["b"].points[0].offset_K == pytest.approx(-1.0, abs=0.01)


@pytest.mark.parametrize("kept", [0.0, 0.8])
def test_standard_errors_hold_for_noise_that_remembers(kept) -> None:
    inside = 0
    for seed in range(300):
        white = np.random.default_rng(seed).standard_normal(451)
        noise = lfilter([0.02 * np.sqrt(1 - kept**2)], [1.0, -kept], white)[150:]
        window = Bath(PERIOD_S * np.arange(301), np.full(301, 20.0), {"a": 20.0 - 0.1 + noise})
        (point,) = calibrated([window], "bath")["a"].points
        inside += abs(point.offset_K - 0.1) < 1.96 * point.standard_error_K
    assert 0.86 <= inside / 300 <= 0.99  # of 0.95; what it estimates of the memory is a little short


def test_each_temperature_gives_a_point_and_the_way_between_gives_none() -> None:
    ramp = np.linspace(40.0, 0.0, 400)
    levels = [np.full(200, 40.0), ramp, np.full(200, 0.0), ramp[::-1], np.full(200, 40.3)]
    record = bath(np.concatenate(levels), {"a": 0.3})
    windows = settled_windows(record, Settled(), "bath")
    tables = calibrated(windows, "bath")
    readings = [point.reading_degC for point in tables["a"].points]
    assert readings == [pytest.approx(-0.3, abs=0.05), pytest.approx(39.85, abs=0.2)]
    assert [point.offset_K for point in tables["a"].points] == pytest.approx([0.3, 0.3], abs=0.01)


def test_a_bath_that_drifts_is_refused() -> None:
    seconds = PERIOD_S * np.arange(400)
    with pytest.raises(Refused) as caught:
        settled_windows(bath(20.0 + 0.001 * seconds, {"a": 0.3}), Settled(), "bath.csv")
    assert str(caught.value) == (
        "bath.csv: not settled: the reference drifts by 0.30 K; in 300 s at most 0.05 K are allowed: "
        "stir, insulate, wait"
    )


@pytest.mark.parametrize(
    ("spoil", "reasons"),
    [
        (lambda window: window.part(0, 100), ["it lasts 198 s of 300 s"]),
        (lambda window: window.part(0, 0), ["it lasts 0 s of 300 s"]),
        (
            lambda window: Bath(
                window.time_s,
                window.reference_degC,
                {**window.probes_degC, "b": window.probes_degC["b"] + 0.001 * window.time_s},
            ),
            ["b drifts by 0.30 K against the reference"],
        ),
        (
            lambda window: Bath(
                window.time_s,
                window.reference_degC,
                {**window.probes_degC, "b": np.where(window.time_s < 100, np.nan, 20.0)},
            ),
            ["b has 101 readings where 121 are needed"],
        ),
        (
            lambda window: Bath(window.time_s, np.full(151, np.nan), {}),
            ["the reference has 0 readings where 121 are needed"],
        ),
        (lambda window: window, []),
    ],
)
def test_what_is_not_settled_says_why(spoil, reasons) -> None:
    window = bath(np.full(151, 20.0), {"a": 0.3, "b": 0.0}, noise_K=0.001)
    assert unsettled(spoil(window), Settled()) == reasons


def test_a_probe_that_is_not_in_the_bath_is_refused() -> None:
    with pytest.raises(Refused) as caught:
        calibrated([bath(np.full(151, 0.0), {"a": 0.3, "b": -21.0}, noise_K=0.0)], "the bath")
    assert str(caught.value) == (
        "the bath: b: reads 21.00 degC where the reference reads 0.00 degC; is it in the bath, of the right type, and "
        "on this channel?"
    )


@pytest.fixture
def laboratory(tmp_path):
    """A simulated thermometer and probes in air of 20 degC, and their drivers."""
    clock = FastClock(200.0)
    far_thermometer = SimulatedThermometer(clock, lambda at_s: 20.0, folder=str(tmp_path))
    far_multiplexer = SimulatedMultiplexer(
        clock, lambda at_s: 20.0, channels=[101, 102], folder=str(tmp_path), errors_K={101: 0.25, 102: -0.5}
    )
    thermometer = Thermometer(far_thermometer.port, clock=clock)
    multiplexer = Multiplexer(far_multiplexer.port, {"a": 101, "b": 102}, clock=clock)
    went: list[int] = []
    yield BathLab(thermometer, multiplexer, ("a", "b"), clock, went.append), far_thermometer, far_multiplexer
    for each in (thermometer, multiplexer, far_thermometer, far_multiplexer):
        each.close()


def test_a_run_ends_when_the_bath_is_settled(laboratory) -> None:
    lab, *_ = laboratory
    assert lab.identify() == "GMH thermometer, number 32407008"
    told: list[list[str]] = []
    run = BathRun(lab, Pace(PERIOD_S, 5000.0))
    window = run.until_settled(Settled(), lambda window, reasons: told.append(reasons))
    tables = calibrated([window], "the bath")
    assert tables["a"].points[0].offset_K == pytest.approx(-0.25, abs=0.02)
    assert tables["b"].points[0].offset_K == pytest.approx(0.5, abs=0.02)
    assert told[0] == ["it lasts 0 s of 300 s"]
    assert told[-1] == []
    assert len(run.record().time_s) == len(told)


def test_a_thermometer_that_never_answers_ends_it_with_its_own_error(laboratory) -> None:
    lab, far_thermometer, _ = laboratory
    far_thermometer.switch_off()
    told: list[str] = []
    with pytest.raises(SwitchedOff):
        BathRun(lab, Pace(PERIOD_S, 1e6)).until_settled(
            Settled(window_s=60.0), lambda window, reasons: told.extend(reasons)
        )
    assert any(reason.endswith("; switch it on") for reason in told)


def test_patience_ends(laboratory) -> None:
    lab, _, far_multiplexer = laboratory
    far_multiplexer.open_circuit(102)
    with pytest.raises(Refused, match=r"the bath: not settled: b has 0 readings where .* stir, insulate, wait"):
        BathRun(lab, Pace(PERIOD_S, 400.0)).until_settled(Settled(), lambda window, reasons: None)


@pytest.fixture
def trace(tmp_path) -> str:
    """A recorded bath at two temperatures."""
    levels = np.concatenate([np.full(200, 0.0), np.linspace(0.0, 30.0, 100), np.full(200, 30.0)])
    record = bath(levels, {"air1": 0.3, "air2": -0.1})
    columns = {
        "bath_degC": record.reference_degC,
        **{f"{name}_degC": each for name, each in record.probes_degC.items()},
    }
    path = str(tmp_path / "bath.csv")
    save_trace(path, Trace(path, record.time_s, columns))
    return path


def test_the_command_makes_offsets_of_a_recorded_bath(trace, tmp_path) -> None:
    output = str(tmp_path / "offsets.yaml")
    ran = CliRunner().invoke(command, [trace, "-o", output])
    assert ran.exit_code == 0, ran.output
    offsets = load_offsets(output)
    assert {name: len(offset.points) for name, offset in offsets.items()} == {"air1": 2, "air2": 2}
    assert offsets["air1"].at(15.0) == pytest.approx(0.3, abs=0.01)
    assert offsets["air2"].at(15.0) == pytest.approx(-0.1, abs=0.01)
    assert "standard error" in ran.output


def test_the_command_writes_nothing_of_a_bath_that_is_not_settled(trace, tmp_path) -> None:
    output = tmp_path / "offsets.yaml"
    ran = CliRunner().invoke(command, [trace, "-o", str(output), "--window", "900"])
    assert isinstance(ran.exception, Refused)
    assert not output.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "take the bath from TRACE.csv, or from --thermometer, --multiplexer and --probe, or --simulate it"),
        (["--simulate", "--probe", "a=101"], "take the bath from TRACE.csv, or from --thermometer"),
        (["--thermometer", "/dev/a"], "live, it needs --thermometer PORT, --multiplexer PORT and a --probe"),
        (
            ["--thermometer", "/dev/a", "--multiplexer", "/dev/a", "--probe", "a=101"],
            "/dev/a is named for both instruments: each has a port of its own",
        ),
        (["--probe", "a"], "--probe a: write it as NAME=CHANNEL, such as air1=101"),
        (["--probe", "a=101", "--probe", "a=102"], "--probe a=102: a stands twice"),
        (["--simulate", "--points", "5"], "the simulated bath goes to 4 temperatures, no more"),
        (["--probe", "1a=101"], "--probe 1a=101: write it as NAME=CHANNEL"),
        (["bath.csv", "--points", "2"], "--points is for a live bath"),
        (["bath.csv", "--record", "other.csv"], "--record is for a live bath"),
    ],
)
def test_a_call_that_is_wrong(arguments, message, tmp_path) -> None:
    ran = CliRunner().invoke(command, [*arguments, "-o", str(tmp_path / "offsets.yaml")])
    assert ran.exit_code == 2
    assert message in " ".join(ran.output.split())


def test_a_port_that_is_not_there_is_no_traceback(tmp_path) -> None:
    call = ["--thermometer", "/nowhere/a", "--multiplexer", "/nowhere/b", "--probe", "a=101", "-o", "offsets.yaml"]
    ran = subprocess.run(
        [sys.executable, "-m", "ambient_trainer", "calibrate", *call], cwd=tmp_path, capture_output=True, text=True
    )
    assert ran.returncode == 1
    assert ran.stderr == (
        "Error: multiplexer on /nowhere/b: expected a port that can be opened, got No such file or directory; plug it "
        "in, or correct the port; it is opened again by itself\n"
    )


def test_the_simulated_bath_is_recorded_and_gives_the_same_offsets_again(tmp_path) -> None:
    output, again, record = (str(tmp_path / name) for name in ("offsets.yaml", "again.yaml", "bath.csv"))
    ran = CliRunner().invoke(command, ["--simulate", "--window", "120", "-o", output, "--record", record])
    assert ran.exit_code == 0, ran.output
    assert "The simulated probes' errors are known: the worst offset misses its by 0.0" in ran.output
    assert list(load_trace(record).columns) == ["bath_degC", "air1_degC", "air2_degC", "air3_degC", "air4_degC"]
    ran = CliRunner().invoke(command, [record, "--window", "120", "-o", again])
    assert ran.exit_code == 0, ran.output
    first, second = load_offsets(output), load_offsets(again)
    assert {name: offset.at(0.0) for name, offset in first.items()} == pytest.approx(
        {name: offset.at(0.0) for name, offset in second.items()}, abs=0.02
    )
