"""The public API from a user's side: cheap to import, frames and paths alike, results that save and show themselves."""

import doctest
import importlib
import inspect
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ambient_trainer as at
from ambient_trainer.data.trace import Trace

VERBS = ("", "fitting", "evaluating", "simulating", "data")
SLOW_EXAMPLE = pytest.param(".api.diagnosing", marks=pytest.mark.slow)
ONE = at.Effort(starts=1)


@pytest.fixture(scope="module")
def log():
    return at.simulate("3", period_s=10.0).trace


@pytest.fixture(scope="module")
def fitted(log):
    return at.fit(log, "free-1", sensors="usb, battery_degC", to_s=3_000, effort=ONE)


def test_the_import_is_cheap_and_every_name_is_there_and_typed():
    heavy = ("numpy", "scipy", "pandas", "plotly", "sklearn", "click")
    code = f"import sys, ambient_trainer as at; print([m for m in {heavy!r} if m in sys.modules], dir(at))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("[] ")
    assert all(repr(name) in done.stdout for name in at.__all__)
    for name in at.__all__:
        assert getattr(at, name) is not None
    with pytest.raises(AttributeError, match="nosuch"):
        at.nosuch
    assert (Path(at.__file__).parent / "py.typed").exists()


@pytest.mark.parametrize("name", ["fit", "evaluate", "diagnose", "simulate", "load_trace"])
def test_the_sections_are_numpydoc_and_name_every_parameter(name):
    function = getattr(at, name)
    doc = inspect.getdoc(function)
    for section in ("Parameters", "Returns", "Raises", "Examples"):
        assert f"\n{section}\n{'-' * len(section)}\n" in doc
    described = doc.split("Returns\n---")[0]
    for parameter in inspect.signature(function).parameters:
        assert parameter in described


@pytest.mark.parametrize("module", [f".api.{verb}" if verb else "" for verb in VERBS] + [SLOW_EXAMPLE])
def test_the_examples_run(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failed, _ = doctest.testmod(importlib.import_module(f"ambient_trainer{module}"))
    assert failed == 0


def test_a_file_its_frame_and_a_trace_give_the_same_model(tmp_path):
    path = at.simulate("2.5", period_s=10.0).save(tmp_path / "run.csv")
    frame = at.load_trace(path)
    trace = Trace(path, frame.index.to_numpy(), {name: frame[name].to_numpy() for name in frame})
    fits = [at.fit(each, "linear_usb", effort=ONE) for each in (path, Path(path), frame, trace)]
    for each in fits:
        assert each.parameters["value"].tolist() == fits[0].parameters["value"].tolist()
        assert each.model.provenance["training"] == fits[0].model.provenance["training"]
    assert at.fit([path, frame], "linear_usb", effort=ONE).fitted.samples == 2 * fits[0].fitted.samples


def test_a_frame_is_known_by_its_content(tmp_path):
    path = at.simulate("2.5", period_s=10.0).save(tmp_path / "run.csv")
    frame = at.load_trace(path)
    model = at.fit(frame, "linear_usb", to_s=500, effort=ONE).model
    changed = frame.copy()
    changed["usb_degC"] += 1.0
    for data, overlaps in ((path, True), (frame, True), (changed, False)):
        assert at.evaluate(model, data).metrics["overlaps_training"].iloc[0] == overlaps
    assert not at.evaluate(model, frame, from_s=500).metrics["overlaps_training"].iloc[0]
    [training] = at.fit(changed, "linear_usb", effort=ONE).model.provenance["training"]
    assert training["trace"] == "DataFrame"


def test_a_fit_has_its_tables(fitted, log, tmp_path):
    assert list(fitted.parameters.index) == [each.name for each in fitted.fitted.parameters]
    random = np.random.default_rng(1)
    usb = 25 + random.normal(size=500).cumsum()
    line = pd.DataFrame({"usb_degC": usb, "ambient_degC": 0.9 * usb - 2 + random.normal(size=500)})
    for name, truth in (("k", 0.9), ("m", -2.0)):
        row = at.fit(line, "linear_usb", effort=ONE).parameters.loc[name]
        assert row.low95 < truth < row.high95
        assert row.identifiable
    assert list(fitted.inputs.index) == ["usb_degC", "battery_degC"]
    assert fitted.inputs["dc_gain"].tolist() == list(fitted.fitted.dc_gains)
    assert np.sqrt(np.mean(fitted.errors["ambient"] ** 2)) == pytest.approx(fitted.rmse_degC)
    assert at.load_model(fitted.save(tmp_path / "model.json")) == fitted.model
    observer = at.fit(log.iloc[::6], "circuit_observer", sensors=["usb", "flash"], effort=ONE)
    assert (observer.inputs["rmse_without_degC"] > 0).all()


def test_an_evaluation_has_its_tables(fitted, log, tmp_path):
    path = fitted.save(tmp_path / "model.json")
    whole, cold = at.evaluate(path, [log, log.iloc[:300]]), at.evaluate(fitted, log, from_s=3_000)
    assert whole.metrics.index.get_level_values("method").tolist() == ["model", "static linear"] * 2
    assert [len(part) for _, part in whole.estimates.groupby("trace")] == [len(log), 300]
    row, samples = cold.metrics.xs("model", level="method").iloc[0], cold.estimates
    assert row["samples"] == samples["error_degC"].count()
    assert row["rmse_degC"] == pytest.approx(np.sqrt((samples["error_degC"] ** 2).mean()))
    inside = samples["reference_degC"].between(samples["low_degC"], samples["high_degC"])
    assert row["coverage_90"] == pytest.approx(inside.mean())
    assert samples["time_s"].iloc[0] == 3_000
    run_in = at.evaluate(fitted, log, from_s=3_000, run_in=True).metrics["rmse_degC"].iloc[0]
    assert cold.metrics["rmse_degC"].xs("model, run in", level="method").iloc[0] == run_in
    data = json.loads(Path(cold.save(tmp_path / "scores.json")).read_text())
    assert data["traces"][0]["rmse_degC"] == row["rmse_degC"]


def test_results_show_themselves(fitted, log, tmp_path):
    run = at.simulate("1", period_s=60.0, hide=["sensor_bias:usb:2K"])
    for number, result in enumerate((fitted, at.evaluate(fitted, log), run)):
        shown = result._repr_html_()
        assert result.summary.title in shown
        assert repr(result) == f"<{type(result).__name__}: {result.summary.title}>"  # not each of its samples
        assert "<script" not in shown
        page = result.report(tmp_path / f"page{number}")
        assert os.path.basename(page) == "index.html"
        assert os.path.exists(page)
    assert "<table>" in fitted._repr_html_()
    assert "sensor_bias" in run._repr_html_()
