"""An observer from log to model file, scored on other logs of the same device through the file."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys

import numpy as np
import pytest

from ambient_model.codec import decode, encode, load_model
from ambient_model.faults import Refused
from ambient_trainer.data.trace import Trace, save_trace
from ambient_trainer.estimation.budget import Cancelled
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.fit import Effort, fit_free_filter
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.estimators.report import report_of
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.report import Finding

EFFORT = Effort(seed=0)


@pytest.fixture(scope="session")
def fitted(brick_log, brick_files):
    """The brick's observer, and what its progress said."""
    heard = []
    fit = estimator(brick_files).fit([brick_log], EFFORT, lambda *said: heard.append(said))
    return fit, heard


@pytest.fixture(scope="session")
def model(fitted):
    return model_of(fitted[0], [], {})


@pytest.fixture(scope="session")
def brick_files(tmp_path_factory, brick_texts):
    folder = tmp_path_factory.mktemp("brick")
    for name, text in brick_texts.items():
        (folder / name).write_text(text)
    return str(folder / "observer.yaml")


def test_the_file_holds_all_that_a_device_needs(fitted, model):
    fit, _ = fitted
    assert decode(encode(model).encode(), "brick.json") == model
    assert [each.name for each in model.main.inputs] == ["chip", "board", "shell"]
    assert set(model.fallbacks) == {"chip", "board", "shell"}
    for name, fallback in model.fallbacks.items():
        assert name not in [each.name for each in fallback.inputs]
    everyone = [model.main, model.secondary.estimator, *model.fallbacks.values()]
    assert all(len(each.states) == 4 for each in everyone)
    assert all([one.period_s for one in each.discrete] == [0.1, 0.2, 0.5, 1.0, 5.0] for each in everyone)
    assert model.secondary.threshold_degC == fit.secondary.threshold_degC
    assert [(term.of, term.lag_s) for term in model.error_variance.terms] == [("movement", 300.0), ("guard", 60.0)]
    low, high = model.error_variance.quantiles[90]
    assert low == -high < 0


def test_the_file_says_how_it_was_made(model):
    told = model.provenance["fit"]
    assert told["main"]["noise_gain"] > 0
    assert told["threshold_degC"] == model.secondary.threshold_degC
    assert told["declared"]["unlogged"]["patterns"]["charge"]["watts"] == [{"board": 1.0}, {"board": 0.7, "shell": 0.3}]
    assert told["declared"]["weights"]["main"]["logged"] == 1
    assert set(told["forward_circuit"]["misfit_degC"]) == {"chip", "board", "shell"}
    json.dumps(model.provenance, allow_nan=False)


def test_every_search_tells_its_progress(fitted):
    fit, heard = fitted
    stages = [stage for stage, _, _ in heard]
    assert stages == sorted(stages)
    assert set(stages) == set(range(6)), "circuit, main, guard and three fallbacks"
    assert all(square > 0 for _, _, square in heard)
    assert len(heard) <= fit.evaluations + 100, "the curvature at the end is told too"


def test_the_report_has_the_figures(fitted):
    report = report_of(fitted[0])
    assert json.loads(json.dumps(report.data, allow_nan=False))["threshold_degC"] > 0
    shown = " ".join(each.text for each in report.sections[1].blocks)
    assert f"{fitted[0].details['main']['noise_gain']:.2f}" in shown
    assert f"{fitted[0].secondary.threshold_degC:.2f} degC" in shown


def test_all_sensors_one_degree_up_is_one_degree_up(fitted):
    fit, _ = fitted
    for each in (fit, fit.secondary.fit, *fit.fallbacks.values()):
        assert sum(each.dc_gains) == pytest.approx(1.0, abs=5e-3)


@pytest.fixture(scope="session")
def unseen(brick_logged):
    return [brick_logged(seed, 4.0) for seed in (11, 12, 13)]


@pytest.fixture(scope="session")
def free(brick_log):
    """The free filter of as many states, fitted to the same log."""
    columns = ("chip_degC", "board_degC", "shell_degC")
    return model_of(fit_free_filter(4, [brick_log], Effort(starts=2), None, None, columns), [], {})


def test_unseen_logs_are_estimated_as_well_as_by_the_free_filter_and_inside_the_interval(model, free, unseen):
    found = [evaluate_trace(model, each) for each in unseen]
    for each, trace in zip(found, unseen):
        assert each.metrics.rmse_degC < 1.05 * evaluate_trace(free, trace).metrics.rmse_degC
    held = np.average([each.coverage[90] for each in found], weights=[each.scored for each in found])
    assert 0.87 < held < 0.96


def test_heat_that_nobody_logs_is_seen_by_the_guard(model, free, brick_logged):
    """A watt into the board that no log tells of: filters that never saw such heat take it for the ambient."""
    odd = brick_logged(14, 4.0, unlogged_W=1.0)
    guarded = evaluate_trace(model, odd)
    for each in (model._replace(secondary=None, error_variance=None), free):
        assert guarded.metrics.rmse_degC < 0.3 * evaluate_trace(each, odd).metrics.rmse_degC
    assert "degraded" in guarded.status


def test_a_log_that_is_too_short_is_refused(brick_files, brick_log):
    with pytest.raises(Refused, match="900 samples"):
        estimator(brick_files).fit([brick_log.cut(None, 4500.0)], EFFORT)


def test_a_log_without_a_drive_is_refused(brick_files, brick_log):
    bare = Trace("bare.csv", brick_log.time_s, {k: v for k, v in brick_log.columns.items() if k != "chip_power_W"})
    with pytest.raises(Refused, match=r"bare\.csv: line 1: no column 'chip_power_W'"):
        estimator(brick_files).fit([bare], EFFORT)


def test_a_log_without_work_is_refused_before_anything_is_searched(brick_files, brick_log):
    idle = {**brick_log.columns, "cpu_load_frac": np.zeros(len(brick_log.time_s))}
    with pytest.raises(Refused, match=r"idle\.csv: column cpu_load_frac: is never above 0\.1; log a run with work"):
        estimator(brick_files).fit([Trace("idle.csv", brick_log.time_s, idle)], *cancelled(0))


def test_the_observer_is_not_fitted_to_gaps(brick_files, brick_log, fitted):
    """A minute without a reference and ten without a sensor move the fit a little, and break nothing."""
    columns = {name: values.copy() for name, values in brick_log.columns.items()}
    columns["ambient_degC"][1000:1006] = np.nan
    columns["board_degC"][2500:2620] = np.nan
    fit = estimator(brick_files).fit([Trace("gaps", brick_log.time_s, columns)], EFFORT)
    assert fit.samples == fitted[0].samples - 120
    assert fit.rmse_degC == pytest.approx(fitted[0].rmse_degC, rel=0.2)


def cancelled(stage: int) -> tuple[Effort, Progress]:
    effort = Effort(seed=0)

    def told(number: int, evaluation: int, square: float) -> None:
        if (number, evaluation) == (stage, 5):
            effort.budget.cancel.cancel()

    return effort, told


def test_ctrl_c_leaves_out_the_fallbacks_that_are_not_found_yet(brick_files, brick_log, fitted):
    fit = estimator(brick_files).fit([brick_log], *cancelled(4))
    assert fit.stopped
    assert not fit.converged
    assert list(fit.fallbacks) == ["chip"]
    assert fit.rmse_degC == fitted[0].rmse_degC
    assert any(each.status == "warning" for each in report_of(fit).lead if isinstance(each, Finding))
    assert list(model_of(fit, [], {}).fallbacks) == ["chip"]


@pytest.mark.parametrize("stage", [0, 1, 2])
def test_before_main_and_guard_are_found_there_is_nothing_to_keep(stage, brick_files, brick_log):
    with pytest.raises(Cancelled):
        estimator(brick_files).fit([brick_log], *cancelled(stage))


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "ambient_trainer", "fit", *arguments]


def test_the_command_writes_model_and_figures(tmp_path, brick_files, brick_log):
    trace, output, figures = (str(tmp_path / name) for name in ("log.csv", "model.json", "fit.json"))
    save_trace(trace, brick_log)
    done = subprocess.run(
        command(trace, "--circuit", brick_files, "-o", output, "--json", figures), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("brick_observer: RMSE 0.")
    assert "Noise gain: " in done.stdout
    with open(figures) as stream:
        assert json.load(stream)["main"]["noise_gain"] > 0
    assert load_model(output).provenance["training"][0]["trace"] == "log.csv"


def test_ctrl_c_ends_it_cleanly_and_writes_nothing(tmp_path, brick_log):
    trace, output = str(tmp_path / "log.csv"), tmp_path / "model.json"
    columns = {name: np.repeat(values, 5) for name, values in brick_log.columns.items()}
    renamed = {"chip_degC": "soc_degC", "board_degC": "flash_degC", "shell_degC": "display_degC"}
    columns = {renamed.get(name, name): values for name, values in columns.items()}
    columns |= {"usb_degC": columns["flash_degC"], "battery_degC": columns["display_degC"]}
    columns["soc_power_W"] = columns.pop("chip_power_W")
    save_trace(trace, Trace(trace, np.arange(len(columns["soc_degC"]), dtype=float), columns))
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        command(trace, "--circuit", "phone_observer", "-o", str(output)), stderr=theirs, stdout=theirs
    ) as process:
        os.close(theirs)
        said = b""
        while b"evaluation" not in said:  # the bar of the first search
            said += os.read(ours, 4096)
        process.send_signal(signal.SIGINT)
        while chunk := read(ours):
            said += chunk
    os.close(ours)
    assert process.returncode == 1
    assert b"searches" in said
    assert said.endswith(b"ambient-trainer: stopped\r\n")
    assert b"Traceback" not in said
    assert not output.exists()


def read(terminal: int) -> bytes:
    """What comes next; nothing where the other end is closed."""
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""
