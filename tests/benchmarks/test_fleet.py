"""What a fleet costs on one process and on two workers, and what partial pooling is worth on fresh runs."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from joblib import parallel_config

import ambient_trainer as at
from ambient_model.codec import load_model
from ambient_trainer.circuits import load_circuit
from ambient_trainer.fleet.causes import learn, name_cause
from ambient_trainer.fleet.dataset import write_dataset
from ambient_trainer.lti.response import states
from ambient_trainer.simulator.fleet import FleetPlan, fleet
from odd_units import PLANTED

SCRIPT = Path(__file__).with_name("fleet_run.py")
UNITS, COPIES = 2000, 5


@pytest.fixture(scope="module")
def hours(tmp_path_factory):
    """Two thousand units of one hour at 1 Hz."""
    folder = str(tmp_path_factory.mktemp("hours") / "logs")
    units = fleet(FleetPlan("5", UNITS, seed=11, minutes=60.0))
    write_dataset(folder, ((each.name, each.trace, {"case": each.case}) for each in units))
    return folder


def took(path: str, engine: str, workers: int, folder: Path) -> dict[str, float]:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, str(SCRIPT), path, engine, str(workers), str(folder)]
    return json.loads(subprocess.run(command, env=environment, capture_output=True, check=True).stdout)


@pytest.mark.timeout(3600)
@pytest.mark.benchmark(group="fleet")
def test_two_workers_beside_one_process(hours, tmp_path, benchmark, noted):
    one = took(hours, "serial", 1, tmp_path / "one")
    two = benchmark.pedantic(took, (hours, "local", 2, tmp_path / "two"), rounds=1, iterations=1)
    task = f"fleet, {UNITS:,} units of 1 h at 1 Hz"
    bare = f"bare fits {one['task_s']:.1f} s, overhead {100 * (one['run_s'] / one['task_s'] - 1):.0f} %"
    noted(task, "one process", one["run_s"], f"{bare}; driver {one['peak_MB']:.0f} MB; load {one['load']:.0f}")
    ratio = f"{two['run_s'] / one['run_s']:.2f} of one process, {two['start_s']:.1f} s to start"
    noted(task, "local, 2 workers", two["run_s"], f"{ratio}; driver {two['peak_MB']:.0f} MB; load {two['load']:.0f}")


@pytest.mark.timeout(3600)
@pytest.mark.benchmark(group="fleet")
def test_the_driver_s_memory(hours, tmp_path, tmp_path_factory, benchmark, noted):
    """Ten thousand units: the same logs under five names."""
    for file in sorted(Path(hours).glob("*.parquet")):
        logs = pq.ParquetFile(file)
        for copy in range(COPIES):
            with pq.ParquetWriter(tmp_path / f"{copy}-{file.name}", logs.schema_arrow) as writer:
                for group in range(logs.num_row_groups):
                    table = logs.read_row_group(group)
                    name = f"{copy}-{table.column('unit')[0].as_py()}"
                    names = pa.array([name] * len(table)).dictionary_encode()
                    writer.write_table(table.set_column(0, "unit", names).cast(logs.schema_arrow))
    found = benchmark.pedantic(took, (str(tmp_path), "local", 2, tmp_path_factory.mktemp("out")), rounds=1)
    task = f"fleet, {UNITS * COPIES:,} units of 1 h at 1 Hz"
    noted(task, "local, 2 workers", found["run_s"], f"driver {found['peak_MB']:.0f} MB; load {found['load']:.0f}")


@pytest.mark.timeout(3600)
@pytest.mark.benchmark(group="causes")
@pytest.mark.parametrize("seed", [41, 42, 43])
def test_causes_named(seed, benchmark, noted):
    """Ten planted units and five others beside forty typical ones."""
    units = list(fleet(FleetPlan("5", 55, seed=seed, period_s=10.0, minutes=180.0, cased=0.0, hide=PLANTED)))
    odd = [each for each in units if each.truth["hidden"]]
    plain = [each for each in units if not each.truth["hidden"]]
    learnt = learn(load_circuit("phone"), [each.trace for each in plain[5:]])

    def named(each):
        with parallel_config(n_jobs=1):
            return name_cause(learnt, each.trace)

    found = benchmark.pedantic(lambda: [named(each) for each in odd], rounds=1, iterations=1)
    for each, one in zip(odd, found):
        noted(f"causes, seed {seed}", each.truth["hidden"][0]["text"], 0.0, str(tuple(one)))
    right = sum(one.cause == each.truth["hidden"][0]["cause"] for each, one in zip(odd, found))
    others = "; ".join(f"{one.cause} {one.confidence}" for one in map(named, plain[:5]))
    noted(f"causes, seed {seed}", "right", benchmark.stats.stats.min, f"{right} of {len(odd)}; no cause: {others}")


PERIOD_S, LONG, COUNT = 5.0, 20, 220
PLAN = FleetPlan("5", COUNT, seed=21, period_s=PERIOD_S)
SCENARIOS = ("5", "4", "1")


def estimate_degC(model, trace):
    """The recursion of a model file over a trace, by arrays."""
    main = model.main
    one = next(each for each in main.discrete if each.period_s == PERIOD_S)
    A, B, C, D = (np.array(each) for each in (one.A, one.B, one.C, one.D))
    u = np.vstack([trace.columns[each.column] for each in main.inputs])
    x = states(A, B @ u, np.array(main.initial) @ u[:, 0])
    return (C @ x + D @ u)[0] + main.offset


def rms(errors):
    return float(np.sqrt(np.mean(errors**2)))


def scores(folder, names, traces):
    """Per unit the RMSE of the population and its own, and the shares within the 90 % intervals."""
    population = load_model(f"{folder}/population.json")
    rows = []
    for name, trace in zip(names, traces):
        own = load_model(f"{folder}/models/{name}.json")
        pooled, partial = (trace.reference - estimate_degC(each, trace) for each in (population, own))
        inside = [np.mean(np.abs(e) < m.main.interval[90][1]) for e, m in ((pooled, population), (partial, own))]
        rows.append((rms(pooled), rms(partial), *inside))
    return np.array(rows).T


def alone(units):
    """Each unit's own fit, of nothing but its log."""
    return [at.fit(each.trace.to_frame(), "free-2", effort=at.Effort(starts=1)).fitted for each in units]


def separate_rms(fits, traces):
    """The RMSE of each on a fresh run of the same unit."""
    return np.array([rms(trace.reference - fit.estimate_degC(trace)) for fit, trace in zip(fits, traces)])


@pytest.mark.timeout(3600)
@pytest.mark.benchmark(group="pooling")
@pytest.mark.parametrize(("cased", "within"), [(0.0, ()), (0.5, ()), (0.5, ("case",))])
def test_errors_on_fresh_runs(cased, within, tmp_path, benchmark, noted):
    """Two hundred units of half an hour, and twenty of all of scenario 5."""
    plan = replace(PLAN, cased=cased)
    units = [*fleet(replace(plan, count=LONG)), *list(fleet(replace(plan, minutes=30.0)))[LONG:]]
    write_dataset(str(tmp_path / "logs"), ((each.name, each.trace, {"case": each.case}) for each in units))
    asked = {"engine": "serial", "effort": at.Effort(starts=4), "within": within}
    benchmark.pedantic(at.fit_fleet, (tmp_path / "logs", "free-2", tmp_path), asked, rounds=1, iterations=1)
    label = f"pooling, {cased:.0%} in a case{', within case' if within else ''}"
    short, full = alone(units[LONG::10]), alone(units[:LONG:2])
    for number, scenario in enumerate(SCENARIOS, 1):
        fresh = [each.trace for each in fleet(replace(plan, scenario=scenario, run=number))]
        pooled, partial, unseen, seen = scores(tmp_path, [each.name for each in units], fresh)
        separate = np.median(separate_rms(short, fresh[LONG::10]))
        of_pooled = np.median(separate_rms(full, fresh[:LONG:2]) / pooled[:LONG:2])
        ratio = partial / pooled
        result = (
            f"pooled {np.median(pooled):.3f}, separate {separate:.1f}, partial {np.median(partial):.3f} degC, ratio "
            f"{np.median(partial) / np.median(pooled):.2f}; worst unit {ratio.max():.2f} of pooled, "
            f"{np.count_nonzero(ratio > 1.05)} above 1.05; inside 90 %: seen {100 * seen.mean():.1f}, "
            f"unseen {100 * unseen.mean():.1f}; with all of scenario 5: separate "
            f"{of_pooled:.2f}, partial {np.median(ratio[:LONG]):.2f} of pooled"
        )
        noted(label, f"fresh {scenario}", benchmark.stats.stats.min, result)


@pytest.mark.timeout(3600)
@pytest.mark.benchmark(group="pooling")
def test_error_by_length_of_the_log(tmp_path, benchmark, noted):
    """Sixty units of 10 to 300 minutes beside twenty of all of scenario 5; half are in a case."""
    long = list(fleet(replace(PLAN, count=LONG)))
    others = list(fleet(replace(PLAN, count=80, minutes=300.0)))[LONG:]
    fresh = [each.trace for each in fleet(replace(PLAN, count=80, run=1))][LONG:]
    last = np.inf

    def fitted(minutes):
        folder = tmp_path / str(minutes)
        cut = [replace(each, trace=each.trace.cut(None, 60.0 * minutes)) for each in others]
        write_dataset(str(folder / "logs"), ((each.name, each.trace, {"case": each.case}) for each in [*long, *cut]))
        at.fit_fleet(folder / "logs", "free-2", folder, engine="serial", effort=at.Effort(starts=4))
        return scores(folder, [each.name for each in cut], fresh), cut

    for minutes in (10, 30, 100, 300):
        (pooled, partial, _, _), cut = (
            benchmark.pedantic(fitted, (minutes,), rounds=1, iterations=1) if minutes == 10 else fitted(minutes)
        )
        separate = np.median(separate_rms(alone(cut[::4]), fresh[::4]))
        result = f"pooled {np.median(pooled):.3f}, partial {np.median(partial):.3f}, separate {separate:.2f} degC"
        noted("pooling, by length", f"{minutes} min", 0.0, result)
        assert np.median(partial) < last
        last = np.median(partial)
