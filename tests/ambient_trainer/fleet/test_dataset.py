"""The same units are read from every form of a dataset; what cannot be read is named."""

import os
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.dataset as pads
import pyarrow.parquet as pq
import pytest

from ambient_model.faults import Refused
from ambient_trainer.data.trace import save_trace
from ambient_trainer.fleet.dataset import Source, entries, logs

SOURCE = Source("unit", ("case",))


def read(path, source=SOURCE):
    return {each.unit: each for each in logs(entries(str(path), source), source)}


@pytest.fixture(scope="module")
def table(logs):
    return pads.dataset(logs).to_table()


def as_csv(folder, table, fleet_units):
    for each in fleet_units:
        save_trace(f"{folder}/{each.name}.csv", replace(each.trace, notes={"case": each.case}))


def one_file(folder, table, fleet_units):
    # sorted by time: each row group holds every unit
    pq.write_table(table.sort_by("time_s"), f"{folder}/all.parquet", row_group_size=1000)


def partitioned(folder, table, fleet_units):
    plain = table.set_column(0, "unit", table.column("unit").cast(pa.string()))
    pads.write_dataset(plain, folder, format="parquet", partitioning=["unit"], partitioning_flavor="hive")


def one_file_a_unit(folder, table, fleet_units):
    for each in fleet_units:
        rows = table.filter(pa.compute.equal(table.column("unit").cast(pa.string()), each.name))
        pq.write_table(rows.drop_columns(["unit"]), f"{folder}/{each.name}.parquet")


@pytest.mark.parametrize("form", [as_csv, one_file, partitioned, one_file_a_unit])
def test_every_form_holds_the_same(form, table, fleet_units, logs, tmp_path):
    folder = tmp_path / "form"
    folder.mkdir()
    form(folder, table, fleet_units)
    found, expected = read(folder), read(logs)
    assert list(found) == [each.name for each in fleet_units]
    for name, each in found.items():
        assert each.group == expected[name].group
        assert each.trace is not None, each.reason
        np.testing.assert_array_equal(each.trace.time_s, expected[name].trace.time_s)
        for column, values in expected[name].trace.columns.items():
            np.testing.assert_array_equal(each.trace.columns[column], values)


def test_row_groups_that_neighbours_share_are_read_for_the_units_that_are_asked(table, fleet_units, tmp_path):
    one_file(tmp_path, table, fleet_units)
    every = entries(str(tmp_path), SOURCE)
    assert [each.unit for each in logs(every[3:5], SOURCE)] == [each.name for each in fleet_units[3:5]]


def test_nothing_there_is_refused_and_a_file_that_is_a_hole_costs_no_memory(tmp_path):
    for place in (tmp_path, tmp_path / "none"):
        with pytest.raises(Refused):
            entries(str(place), SOURCE)
    for name in ("hole.csv", "hole.parquet"):
        with open(tmp_path / name, "wb") as stream:
            stream.truncate(10 * 2**30)
    for name in ("gone.csv", "gone too.parquet"):
        os.symlink("/nowhere", tmp_path / name)
    found = read(tmp_path)
    assert os.path.getsize(tmp_path / "hole.csv") == 10 * 2**30
    assert {name: each.trace for name, each in found.items()} == dict.fromkeys(("gone", "gone too", "hole"))


READINGS = {"a_degC": np.arange(20.0), "ambient_degC": np.arange(20.0)}


def test_a_unit_may_be_of_any_type_and_in_a_file_of_its_own_and_the_number_of_a_row_is_no_time(tmp_path):
    time_s = np.arange(20.0)
    for number, (one, other) in enumerate([(1.0, 2.5), (b"001", b"a/b"), ([3], [4]), ("ü", "样机" * 15)]):
        mixed = {"unit": [one] * 8 + [other] * 12, "time_s": time_s, **READINGS}
        pq.write_table(pa.table(mixed), tmp_path / f"{number}.parquet")
    pq.write_table(pa.table({"time_s": 20.0 + time_s, **READINGS}), tmp_path / "2.5.parquet")
    frame = pd.DataFrame(READINGS, index=pd.Index(10.0 * time_s, name="time_s"))
    frame.to_parquet(tmp_path / "indexed.parquet", row_group_size=7)
    frame.rename_axis("at").to_parquet(tmp_path / "unnamed.parquet")
    found = read(tmp_path)
    rows = {name: len(each.trace.time_s) for name, each in found.items() if each.trace}
    assert rows == {"001": 8, "1": 8, "2.5": 32, "a/b": 12, "ü": 8, "indexed": 20}
    np.testing.assert_array_equal(found["indexed"].trace.time_s, frame.index)
    assert found["unnamed"].reason == "column time_s: missing"
