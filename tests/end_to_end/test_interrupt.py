"""Ctrl-C ends a fit and keeps the best so far, marked as such."""

import json

from ambient_model.codec import load_model


def test_ctrl_c_leaves_the_best_model_so_far(call, interrupted, tmp_path):
    trace, model = tmp_path / "trace.csv", tmp_path / "model.json"
    assert call("ambient-trainer", "simulate", "2.1", "--period", "5", "-o", trace)[0] == 0
    status, printed, _ = interrupted("best", "fit", trace, "--circuit", "free-4", "--starts", "1000", "-o", model)
    assert status == 1
    assert "Stopped before the search was over" in printed
    assert load_model(str(model)).provenance["fit"]["stopped"] is True
    assert json.loads(model.read_text())["name"] == "free-4"
