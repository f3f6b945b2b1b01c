"""A whole run: the same bytes on every engine, a row for every unit, and models that a device runs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import ambient_trainer as at
from ambient_model.codec import load_model
from ambient_model.faults import Refused
from ambient_trainer.data.trace import save_trace
from ambient_trainer.evaluation import evaluate_trace
from ambient_trainer.fleet import engine, fit_units, run
from ambient_trainer.simulator.fleet import fleet
from refusals import refused

from .conftest import PLAN
from .test_dataset import as_csv

EFFORT = at.Effort(starts=2)


@pytest.fixture(scope="module")
def fitted(logs, tmp_path_factory):
    return at.fit_fleet(logs, "free-1", tmp_path_factory.mktemp("fitted"), engine="serial", effort=EFFORT)


def test_each_unit_has_a_row_and_a_model_that_a_device_runs(fitted, fleet_units):
    folder = Path(fitted.fitted.folder)
    table = pd.read_parquet(folder / "fleet.parquet")
    assert table["unit"].tolist() == [each.name for each in fleet_units]
    assert (table["status"] == "ok").all()
    rows = table.set_index("unit")
    for each in list(fleet(replace(PLAN, run=1)))[:4]:  # in another usage
        model = load_model(str(folder / "models" / f"{each.name}.json"))
        low, high = model.main.interval[90]
        assert high == pytest.approx(rows.loc[each.name, "half_width_90_degC"])
        assert low == -high
        assert model.provenance["fit"]["fleet"]["shrinkage"] == rows.loc[each.name, "shrinkage"]
        assert evaluate_trace(model, each.trace).metrics.rmse_degC < 5
    assert load_model(str(folder / "population.json")).main.interval[90][1] > rows["half_width_90_degC"].median()


def test_parameters_are_those_of_the_model_file(fitted):
    row = fitted.units.iloc[0]
    model = load_model(f"{fitted.fitted.folder}/models/{row.name}.json")
    one = min(model.main.discrete, key=lambda each: abs(each.period_s - 1))
    A, B, C, D = (np.array(each) for each in (one.A, one.B, one.C, one.D))
    gain = (D + C @ np.linalg.solve(np.eye(len(A)) - A, B))[0]
    names = [f"dc_gain_{each.name}" for each in model.main.inputs]
    np.testing.assert_allclose(gain, row[names].to_numpy(dtype=float), atol=1e-9)
    assert model.main.offset == pytest.approx(row["offset_degC"])


def test_chunks_do_not_change_what_is_found(fitted, logs, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "CHUNK", 3)
    again = at.fit_fleet(logs, "free-1", tmp_path, engine="serial", effort=EFFORT)
    pd.testing.assert_frame_equal(again.units, fitted.units, rtol=1e-9)


def test_a_frame_gives_what_its_dataset_gives(fitted, fleet_units, tmp_path):
    frame = pd.concat([each.trace.to_frame().assign(unit=each.name) for each in fleet_units]).reset_index()
    again = at.fit_fleet(frame, "free-1", tmp_path, engine="serial", effort=EFFORT)
    pd.testing.assert_frame_equal(again.units, fitted.units)


REASONS = {"no-reference": "ambient", "no-sensor": "usb", "all-missing": "usb", "empty": "no rows", "header": "no rows"}


def test_a_unit_that_cannot_be_fitted_is_a_row_with_the_reason(fleet_units, trainer, tmp_path):
    """Five are not; of one the clock was set meanwhile, one has hours as steps."""
    broken = tmp_path / "logs"
    broken.mkdir()
    (broken / "empty.csv").write_text("")
    (broken / "header.csv").write_text("time_s,usb_degC,ambient_degC\n")
    made, trace = {each.name: each.trace for each in fleet_units[:8]}, fleet_units[0].trace
    made |= {"no-reference": _without(trace, "ambient_degC"), "no-sensor": _without(trace, "usb_degC")}
    made["all-missing"] = replace(trace, columns={**trace.columns, "usb_degC": np.nan * trace.time_s})
    made["clock-set"] = replace(trace, time_s=trace.time_s + 1.7e9 * (trace.time_s > 900.0))
    made["hourly"] = replace(trace, time_s=360.0 * trace.time_s)
    for name, each in made.items():
        save_trace(f"{broken}/{name}.csv", each)
    asked = ("fleet", broken, "--circuit", "free-1", "--engine", "serial", "--starts", 1)
    stale = broken / "one/models/no-sensor.json"
    stale.parent.mkdir(parents=True)
    stale.touch()
    status, _, _ = trainer(*asked, "-o", broken / "one", "--json", tmp_path / "one.json")
    assert (status, stale.exists()) == (0, False)
    table = pd.read_parquet(broken / "one" / "fleet.parquet").set_index("unit")
    failed = table[table["status"] == "failed"]["reason"]
    assert set(failed.index) == set(REASONS)
    for name, word in REASONS.items():
        assert word in failed[name], name
    assert json.loads((tmp_path / "one.json").read_text())["failed"] == failed.to_dict()
    assert trainer(*asked, "-o", tmp_path / "two", "--strict")[0] == 1
    assert (tmp_path / "two/models/hourly.json").exists(), "what a run before has left among the logs is none"
    status, _, error = trainer(*asked, "-o", tmp_path / "three", "--diagnose", "nophone")
    assert (status, error.startswith("ambient-trainer: diagnose: none is called 'nophone'")) == (1, True)


@pytest.mark.parametrize("form", ["file", "folder", "broken", "unlike"])
def test_fewer_than_two_units_are_refused_before_the_engine_starts(form, fleet_units, trainer, tmp_path, monkeypatch):
    """A single trace, a folder of one, one beside an unreadable file; of two without a common column a worker tells."""
    logs = tmp_path / "logs"
    logs.mkdir()
    trace = fleet_units[0].trace
    save_trace(f"{logs}/one.csv", trace)
    if form == "broken":
        (logs / "two.parquet").write_bytes(b"no parquet")
    if form == "unlike":
        save_trace(f"{logs}/two.csv", _without(trace, "ambient_degC"))
    else:
        monkeypatch.setattr(engine.Dask, "__enter__", lambda _: pytest.fail("the engine was started"))
    asked = logs / "one.csv" if form == "file" else logs
    how = ("--engine", "serial") if form == "unlike" else ()
    status, _, error = trainer("fleet", asked, "--circuit", "free-1", "-o", tmp_path / "out", *how)
    assert status == 1
    assert f"{asked}: a fleet has 2 units at least, and 1 of {1 + (form in ('broken', 'unlike'))} here" in error
    assert {"broken": "two: cannot be read", "unlike": "two: "}.get(form, "name a folder of traces") in error
    assert form == "unlike" or not (tmp_path / "out").exists()


def test_an_interrupted_run_goes_on_and_another_is_refused(fleet_units, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "CHUNK", 4)
    logs, log = tmp_path / "logs", tmp_path / "logs" / f"{fleet_units[0].name}.csv"
    logs.mkdir()
    as_csv(logs, None, fleet_units)
    whole = at.fit_fleet(logs, "free-1", tmp_path / "whole", engine="serial", effort=EFFORT)
    seen = []

    def stop(what, done, total):
        seen.append((what, done))
        if what.startswith("summarising") and done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        at.fit_fleet(logs, "free-1", tmp_path / "part", engine="serial", effort=EFFORT, progress=stop)
    for circuit, content in (("free-2", log.read_bytes()), ("free-1", log.read_bytes() + b"\n")):
        log.write_bytes(content)
        with pytest.raises(Refused, match="resume"):
            at.fit_fleet(logs, circuit, tmp_path / "part", engine="serial", effort=EFFORT, resume=True)
    log.write_bytes(content[:-1])
    (tmp_path / "part/.parts/look-000001.pickle").write_bytes(b"")  # after a power failure
    begun = []
    monkeypatch.setattr(fit_units, "initialise", lambda *_: begun.append(1))
    asked = {"engine": "serial", "effort": EFFORT, "progress": lambda *now: seen.append(now)}
    at.fit_fleet(logs, "free-1", tmp_path / "part", resume=True, **asked)
    assert not begun
    assert ("summarising units", 1, 4) in seen
    part, unbroken = (Path(each, "fleet.parquet") for each in (tmp_path / "part", whole.fitted.folder))
    assert part.read_bytes() == unbroken.read_bytes()


@pytest.mark.parametrize(
    ("circuit", "fallbacks"),
    [("linear_combined", 0), ("model2_ss", 0), pytest.param("free_observer", 5, marks=pytest.mark.slow)],
)
def test_every_kind_of_estimator_is_pooled(logs, fleet_units, tmp_path, circuit, fallbacks):
    found = at.fit_fleet(logs, circuit, tmp_path, engine="serial", effort=at.Effort(starts=1))
    assert found.failed.empty
    assert found.units["rmse_partial_degC"].median() <= found.units["rmse_pooled_degC"].median()
    for each in fleet_units[:2]:
        model = load_model(str(tmp_path / "models" / f"{each.name}.json"))
        assert len(model.fallbacks) == fallbacks
        assert np.isfinite(evaluate_trace(model, each.trace).metrics.rmse_degC)


@pytest.mark.parametrize("circuit", ["phone", "nothing"])
def test_what_gives_no_ambient_is_refused(logs, tmp_path, circuit):
    refused(at.fit_fleet, logs, circuit, tmp_path, engine="serial", effort=EFFORT)


def _without(trace, column):
    return replace(trace, columns={name: values for name, values in trace.columns.items() if name != column})
