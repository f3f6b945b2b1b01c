"""The README's first command: the whole path with no data, on simulated temperatures."""

import json
import re

import pytest

from ambient_model.codec import load_model
from ambient_trainer.data.trace import load_trace


@pytest.mark.slow
def test_the_whole_path(process, tmp_path, as_documented):
    printed = process("ambient_trainer", "demo", "-o", tmp_path / "out")
    as_documented("README.md", "It prints this table", printed)
    replayed = float(re.search(r"([\d.]+) degC off \(RMSE, simulated\)", printed)[1])
    (row,) = re.findall(r"^ free-2 .*", printed, flags=re.MULTILINE)
    _, _, _, _, held_out, static, *_ = row.split()
    assert float(held_out) == replayed < float(static)
    out = tmp_path / "out"
    assert load_trace(str(out / "training.csv")).notes["simulated"] == "yes"
    model = load_model(str(out / "model.json"))
    assert [each["trace"] for each in model.provenance["training"]] == ["training.csv"]
    assert "verification.csv" in (out / "report" / "index.html").read_text()
    assert (out / "report" / "plotly.min.js").stat().st_size > 1e6
    figures = tmp_path / "figures.json"
    process("ambient_trainer", "evaluate", out / "model.json", out / "verification.csv", "--json", figures)
    (again,) = json.loads(figures.read_text())["traces"]
    assert round(again["rmse_degC"], 2) == replayed
    inside98 = again["coverage"]["98"]
    statuses = [line.rpartition(",")[2] for line in (out / "replay.csv").read_text().splitlines()[1:]]
    warming_up_min = (len(statuses) - statuses[::-1].index("warming_up")) / 60
    print(f"warming_up for {warming_up_min:.1f} min; {100 * inside98:.1f} % of all errors inside the 98 % interval")
    assert warming_up_min <= 20
    assert inside98 >= 0.97
