"""Whatever is wrong with a file or a call: one message with file, place and hint, status 1 or 2, outputs untouched.

Each reader's own faults are tested beside it; here a model goes wrong through the commands that read it.
"""

import json

import numpy as np
import pytest

from ambient_model.codec import load_model

OLD = "what was there before"
_RNG = np.random.default_rng(3)
_ROWS = np.column_stack([np.arange(60.0), 20 + _RNG.normal(size=(60, 2)).cumsum(axis=0)]).round(3).tolist()
GOOD = "\n".join(["time_s,usb_degC,ambient_degC", *(",".join(map(str, row)) for row in _ROWS)]) + "\n"


@pytest.fixture
def good(call, tmp_path):
    """A trace and the model fitted to it."""
    trace, model = tmp_path / "trace.csv", tmp_path / "model.json"
    trace.write_text(GOOD)
    assert call("ambient-trainer", "fit", trace, "--circuit", "free-1", "-o", model)[0] == 0
    return trace, model


@pytest.mark.parametrize("fault", ["cut off", "unknown version", "another sensor"])
def test_a_model_that_is_broken_or_of_another_trace(call, good, tmp_path, fault):
    _, model = good
    other, out = tmp_path / "other.csv", tmp_path / "out.csv"
    place = {"cut off": "model.json: line ", "unknown version": "model.json: version: "}.get(fault, "other.csv: ")
    text = model.read_text()
    model.write_text(
        {"cut off": text[:300], "unknown version": text.replace('"version": 1', '"version": 2')}.get(fault, text)
    )
    other.write_text(GOOD.replace("usb", "skin") if fault == "another sensor" else GOOD)
    out.write_text(OLD)
    for command in (
        ("ambientd", "replay", model, other, "-o", out),
        ("ambient-trainer", "evaluate", model, other, "--json", out),
    ):
        status, _, said = call(*command)
        assert status in (1, 2)
        assert place in said
        assert ("usb_degC" in said) == (fault == "another sensor")
        assert out.read_text() == OLD


def test_a_link_keeps_leading_where_it_led(call, good, tmp_path):
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    assert call("ambient-trainer", "fit", good[0], "--circuit", "free-1", "-o", tmp_path / "link.json")[0] == 0
    assert (tmp_path / "link.json").is_symlink()
    assert json.loads((tmp_path / "real.json").read_text())["name"] == "free-1"


def test_ctrl_c_leaves_the_best_model_so_far(call, interrupted, tmp_path):
    trace, model = tmp_path / "trace.csv", tmp_path / "model.json"
    assert call("ambient-trainer", "simulate", "2.1", "--period", "5", "-o", trace)[0] == 0
    status, printed, _ = interrupted("best", "fit", trace, "--circuit", "free-4", "--starts", "1000", "-o", model)
    assert status == 1
    assert "Stopped before the search was over" in printed
    assert load_model(str(model)).provenance["fit"]["stopped"] is True
    assert json.loads(model.read_text())["name"] == "free-4"
