"""The thesis's protocol as one command: it trains, evaluates, prints, and leaves figures and a page behind."""

import json
import os
import pty
import signal
import subprocess
import sys

import pytest
from scipy.stats import spearmanr

SCENARIOS = {"1", "2.1", "2.2", "2.3", "2.4", "2.5", "3", "4"}
RELATED = {"chau_linear_battery", "he_svr", "ishii_transfer_functions", "li_fixed_point"}
OURS = {"circuit_observer", "free_observer"}


@pytest.fixture(scope="module")
def reproduced(process, tmp_path_factory):
    """(what it printed, its JSON, its page)."""
    folder = tmp_path_factory.mktemp("reproduce")
    printed = process(
        "ambient_trainer", "reproduce", "--json", folder / "found.json", "--report", folder / "report", "--seed", "1"
    )
    return printed, json.loads((folder / "found.json").read_text()), (folder / "report" / "index.html").read_text()


def test_every_model_in_every_scenario(reproduced):
    _, found, _ = reproduced
    corrected = [row for row in found["rows"] if row["variant"] == "corrected"]
    models = {row["model"] for row in corrected}
    assert len(models) == 10 + len(RELATED)
    assert models > RELATED
    assert {(row["model"], row["scenario"]) for row in corrected} == {(m, s) for m in models for s in SCENARIOS}
    assert len(corrected) == len(models) * len(SCENARIOS)
    assert all(row["reproduced"] is not None for row in corrected)
    assert {row["variant"] for row in found["rows"]} == {
        "corrected", "as_printed", "noncausal", "published_parameters", "ours",
    }  # fmt: skip


def test_published_figures_stand_where_there_are_any(reproduced):
    _, found, _ = reproduced
    for row in found["rows"]:
        known = row["model"] not in RELATED | OURS and row["scenario"] not in ("2.2", "2.5")
        assert (row["published"] is not None) == known
    (best,) = [
        row["published"]
        for row in found["rows"]
        if (row["scenario"], row["model"], row["variant"]) == ("4", "model2_ss_free_cd", "corrected")
    ]
    assert (best["rmse_degC"], best["mae_degC"], best["mbe_degC"]) == (1.30, 0.92, 0.11)


def test_our_observers_stand_apart_and_beat_the_thesis_s_best(reproduced):
    """In the thesis's verification run, on a device it has never seen in that weather."""
    printed, found, page = reproduced
    ours = {(row["model"], row["scenario"]): row["reproduced"] for row in found["rows"] if row["variant"] == "ours"}
    assert ours.keys() == {(model, scenario) for model in OURS for scenario in SCENARIOS}
    best = min(
        row["reproduced"]["rmse_degC"]
        for row in found["rows"]
        if row["scenario"] == "4" and row["variant"] == "corrected" and row["model"] not in RELATED
    )
    for model in OURS:
        assert ours[model, "4"]["rmse_degC"] < 0.5 * best
    for name in ("Ours: circuit observer", "Ours: free observer"):
        assert printed.count(name) == 2 * len(SCENARIOS) + 1
        assert name in page


def test_the_correlation_is_that_of_the_rows(reproduced):
    _, found, _ = reproduced
    pairs = [
        (row["published"]["rmse_degC"], row["reproduced"]["rmse_degC"])
        for row in found["rows"]
        if row["published"]
        and row["variant"] == ("noncausal" if row["model"] == "model1_ss_single_input" else "corrected")
    ]
    assert len(pairs) == 60
    assert found["spearman"] == pytest.approx(spearmanr(*zip(*pairs)).statistic)
    assert found["spearman"] >= 0.85


def test_the_tables_are_printed_and_called_simulated(reproduced):
    printed, found, page = reproduced
    for number in range(1, 13):
        assert f"Table 5.{number}: " in printed
        assert f"Table 5.{number}: " in page
    assert printed.count("(simulated)") == 9
    assert f"a Spearman correlation of {found['spearman']:.2f}" in printed
    for line in found["shortfalls"]:
        assert f"- {line}" in printed
    assert "What the thesis gets wrong, computed" in page
    assert "How well the simulated phone is calibrated" in page


def test_ctrl_c_stops_it_without_a_traceback(tmp_path):
    terminal, end = pty.openpty()  # the bar shows on a terminal only, and says what is under way
    command = [sys.executable, "-m", "ambient_trainer", "reproduce", "--json", str(tmp_path / "found.json")]
    with open(tmp_path / "printed", "w") as printed:  # a pipe that nobody reads would stop it for ever
        running = subprocess.Popen(command, stdout=printed, stderr=end, text=True)
    os.close(end)
    seen = b""
    while b"fitting" not in seen:
        seen += os.read(terminal, 1024)
    running.send_signal(signal.SIGINT)
    while b"stopped" not in seen and running.poll() is None:
        seen += os.read(terminal, 1024)
    assert running.wait(timeout=60) == 1
    os.close(terminal)
    assert (tmp_path / "printed").read_text() == ""
    assert b"Traceback" not in seen
    assert not (tmp_path / "found.json").exists()
