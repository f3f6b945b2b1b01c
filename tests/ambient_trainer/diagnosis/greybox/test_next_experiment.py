"""The proposed experiment predicts what a closed form does, for the cause and without it."""

import re

import numpy as np
import pytest

from ambient_trainer.diagnosis.findings import steps_of
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.greybox.stepwise import anchors, bare_fit, lasting_candidates, stepwise
from ambient_trainer.diagnosis.next_experiment import _largest, next_experiment

UNITS_S = {"s": 1.0, "min": 60.0, "h": 3600.0}


@pytest.mark.slow
def test_a_step_of_the_driver_is_proposed(circuit, simulated, recorded):
    seed = int(np.random.default_rng().integers(1 << 30))
    records = recorded(simulated(seed, heat_W=lambda now, degC: 0.8 * now["current_A"] ** 2))
    model = GreyBox.of(circuit)
    selection = stepwise(bare_fit(model, records), anchors(model, records), offered=lasting_candidates)
    said = next_experiment(selection, steps_of(selection, 0))
    found = re.search(
        r"take `(\w+)` from (\S+) to (\S+): after (\S+) (s|min|h), `board` reads (\S+) degC if .*?,"
        r" (\S+) degC if nothing",
        said,
    )
    assert found, (seed, said)
    column, before, after, span, unit, warm, cold = found.groups()
    assert column == "current_A"
    C, R, k = (number.value for number in selection.final.model.numbers)
    settling = 1.0 - np.exp(-float(span) * UNITS_S[unit] / (R * C))
    rise = R * k * (float(before) ** 2 + (float(after) ** 2 - float(before) ** 2) * settling)
    # the time is said to two figures
    assert float(warm) - float(cold) == pytest.approx(rise, rel=0.05), (seed, said)


@pytest.mark.parametrize("heat_W", [20.0, -20.0])
def test_no_reading_is_predicted_far_from_what_the_log_has_seen(circuit, simulated, recorded, heat_W):
    records = recorded(simulated(1, heat_W=lambda now, degC: 0.8 * now["current_A"]))
    model = GreyBox.of(circuit)
    heat = next(
        each
        for each in lasting_candidates(Scene(fit(model, records, most=0)), lambda mechanism: np.zeros(1))
        if each.key == ("heat_source", ("board",), "current_A")
    )
    one = fit(model, records, most=0)
    other = fit(model.with_mechanism(heat.with_values([heat_W])), records, most=0)
    found = _largest(one, other)
    assert found is not None
    low, high = np.nanmin(records[0].sensors), np.nanmax(records[0].sensors)
    assert all(low - 15 < each < high + 15 for each in found.readings_degC)
