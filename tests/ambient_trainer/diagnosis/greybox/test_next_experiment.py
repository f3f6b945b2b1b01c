"""The proposed experiment predicts what a closed form does, for the cause and without it."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from ambient_trainer.diagnosis.findings import cause_of, steps_of
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.mechanisms.sensor import Bias, Drift
from ambient_trainer.diagnosis.greybox.model import GreyBox, Number
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.screening import permanent_candidates
from ambient_trainer.diagnosis.greybox.stepwise import anchors, bare_fit, stepwise
from ambient_trainer.diagnosis.greybox.trials import Trial
from ambient_trainer.diagnosis.next_experiment import _closest, _largest, next_experiment

UNITS_S = {"s": 1.0, "min": 60.0, "h": 3600.0}


def heat_at_board(heat_W, driver=None):
    return Heat(("board",), (Number("heat_board", "W", heat_W),), None if driver is None else Expression(driver))


@pytest.mark.slow
def test_a_step_of_the_driver_is_proposed(circuit, simulated, recorded, seed):
    records = recorded(simulated(seed, heat_W=lambda now, degC: 0.8 * now["current_A"] ** 2))
    model = GreyBox.of(circuit)
    selection = stepwise(bare_fit(model, records), anchors(model, records), offered=permanent_candidates)
    text = next_experiment(selection, steps_of(selection, 0))
    found = re.search(
        r"take `(\w+)` from (\S+) to (\S+): after (\S+) (s|min|h), `board` reads (\S+) degC if .*?,"
        r" (\S+) degC if nothing",
        text,
    )
    assert found, (seed, text)
    column, before, after, span, unit, warm, cold = found.groups()
    assert column == "current_A"
    C, R, k = (number.value for number in selection.final.model.numbers)
    settling = 1.0 - np.exp(-float(span) * UNITS_S[unit] / (R * C))
    rise = R * k * (float(before) ** 2 + (float(after) ** 2 - float(before) ** 2) * settling)
    # the time is said to two figures
    assert float(warm) - float(cold) == pytest.approx(rise, rel=0.05), (seed, text)


def test_no_column_is_moved_without_the_one_that_goes_along_and_an_offset_needs_a_second_thermometer(circuit):
    def trial(mechanism):
        return Trial(mechanism, SimpleNamespace(model=GreyBox.of(circuit)), 0.5, at_bounds=False)

    def asked(chosen, rival):
        trials = [trial(chosen), trial(rival)]
        compared = SimpleNamespace(trials=trials)
        selection = SimpleNamespace(compared=compared, steps=[SimpleNamespace(chosen=trials[0])], bare=None)
        return selection, [
            SimpleNamespace(cause=cause_of(chosen, circuit), indistinguishable_from=[cause_of(rival, circuit)])
        ]

    selection, steps = asked(heat_at_board(1.0, "sun_W_m2"), heat_at_board(1.0, "ghi_W_m2"))
    assert _closest(selection, steps[0], selection.steps[0].chosen) is None
    selection, steps = asked(heat_at_board(1.0, "current_A^2"), heat_at_board(1.0, "current_A"))
    assert _closest(selection, steps[0], selection.steps[0].chosen) is selection.compared.trials[1]
    text = next_experiment(*asked(heat_at_board(1.0), Bias(("board",), (Number("bias_board", "degC", 1.0),))))
    assert "thermometer" in text
    assert "`board`" in text
    drift = Drift(("board",), (Number("drift_board", "K/h", 1.0),))
    text = next_experiment(*asked(drift, heat_at_board(1.0, "time_s")))
    assert "`board`: it agrees with the sensor if the cause is heat_source at board by time_s" in text


@pytest.mark.parametrize("heat_W", [20.0, -20.0])
def test_no_reading_is_predicted_far_from_what_the_log_has_seen(circuit, simulated, recorded, heat_W):
    records = recorded(simulated(1, heat_W=lambda now, degC: 0.8 * now["current_A"]))
    one = fit(GreyBox.of(circuit), records, most=0)
    heated = one.model.with_mechanism(heat_at_board(heat_W, "current_A"))
    found = _largest(one, fit(heated, records, most=0, prior=one.prior))
    assert found is not None
    low, high = np.nanmin(records[0].sensors), np.nanmax(records[0].sensors)
    assert all(low - 15 < each < high + 15 for each in found.readings_degC)


def test_what_shows_only_beside_other_causes_is_asked_for_beside_them(circuit, simulated, recorded):
    records = recorded(simulated(1, heat_W=lambda now, degC: 0.8 * now["current_A"]))
    bare = fit(GreyBox.of(circuit), records, most=0)
    heat = heat_at_board(1.0, "current_A")
    final = fit(bare.model.with_mechanism(heat).with_mechanism(heat_at_board(0.1)), records, prior=bare.prior)
    chosen = Trial(heat, bare, 0.5, at_bounds=False)
    step, compared = SimpleNamespace(chosen=chosen), SimpleNamespace(trials=[])
    selection = SimpleNamespace(bare=bare, final=final, compared=compared, steps=[step])
    found = SimpleNamespace(cause=cause_of(heat, circuit), indistinguishable_from=[])
    assert "take `current_A`" in next_experiment(selection, [found])
