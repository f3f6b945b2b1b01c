"""What a user calls a circuit becomes what fits it, or is refused before a trace is read."""

import json
from pathlib import Path

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.registry import estimator, thermal_circuit
from ambient_trainer.estimators.report import report_of

ONE = Effort(starts=1)


@pytest.fixture
def trace():
    """Five sensors that wander, and an ambient below them."""
    random = np.random.default_rng(0)
    columns = {
        f"{name}_degC": 25 + np.cumsum(random.normal(size=600)) * 0.2
        for name in ("soc", "flash", "battery", "usb", "display")
    }
    columns["ambient_degC"] = columns["usb_degC"] - 3 + random.normal(size=600) * 0.2
    return Trace("log.csv", np.arange(600.0), columns)


def test_a_shipped_name_a_file_and_a_free_filter(trace):
    assert estimator("linear_usb").fit([trace], ONE).inputs == ("usb_degC",)
    path = Path(__file__).parents[2] / "data" / "circuits" / "three_nodes.yaml"
    with pytest.raises(Refused, match="no column 'cpu_power_W'"):
        estimator(str(path)).fit([trace], ONE)
    assert len(estimator("free-2").fit([trace], ONE).inputs) == 5
    assert estimator("free-2").fit([trace], ONE, inputs=["usb_degC"]).inputs == ("usb_degC",)


def test_an_unknown_name_is_refused_before_any_trace_is_read():
    with pytest.raises(Refused) as refused:
        estimator("free-9")
    for name in ("phone", "phone_observer", "free-1", "free-4", "circuit_observer"):
        assert f" {name}," in str(refused.value)


def test_where_a_thermal_circuit_is_asked_for_a_free_filter_is_none_and_not_offered():
    assert thermal_circuit("model2_ss").name == "model2_ss"
    with pytest.raises(Refused) as refused:
        thermal_circuit("free-2")
    assert str(refused.value).startswith("--circuit: free-2")
    with pytest.raises(Refused) as refused:
        thermal_circuit("free-9")
    assert "free-1" not in str(refused.value)


def test_a_circuit_names_its_own_sensors():
    with pytest.raises(Refused) as refused:
        estimator("linear_usb", ["usb_degC"])
    for name in ("--sensors", "linear_usb", "free-1", "circuit_observer", "free_observer"):
        assert name in str(refused.value)


@pytest.mark.parametrize("name", ["free-1", "model2_ss", "linear_combined"])
def test_the_machines_view_is_plain_json(name, trace):
    """An unidentifiable circuit has no intervals: null, never NaN."""
    fit = estimator(name).fit([trace], ONE)
    said = json.loads(json.dumps(report_of(fit).data, allow_nan=False))
    assert said["rmse_degC"] == fit.rmse_degC
    assert [each["name"] for each in said["parameters"]] == [each.name for each in fit.parameters]
    assert said["identifiable"] == fit.identifiable == (name != "model2_ss")
    gains = [said["dc_gains"][column] for column in fit.inputs]
    if fit.states:
        at_rest = fit.system.D - fit.system.C @ np.linalg.inv(fit.system.A) @ fit.system.B
        assert gains == pytest.approx(at_rest[0].tolist(), rel=1e-6, abs=1e-9)
    else:
        assert gains == fit.system.D[0].tolist()
