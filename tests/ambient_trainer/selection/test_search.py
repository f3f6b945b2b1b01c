"""The whole search on the made-up device: it finds what is right, and the same however it is run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.selection.found import Options
from ambient_trainer.selection.report import as_json, findings
from ambient_trainer.selection.screen import screened
from ambient_trainer.selection.search import prepared, searched
from ambient_trainer.selection.state import State
from ambient_trainer.selection.work import Work

from .conftest import AGAIN, LONER, OPTIONS, PAIR, found_in, made_up


def test_the_right_pair_is_named(found):
    assert found.sizes[0].sensors == (LONER,)
    assert found.sizes[1].sensors == PAIR
    assert found.named == 1
    assert found.sizes[1].held_out.rmse_degC < 0.3 * found.sizes[0].held_out.rmse_degC
    assert found.sizes[1].filter.dc_gains == pytest.approx((-1.0, 2.0), abs=0.1)


def test_circuits_of_the_pair_beat_those_of_one_sensor(found):
    assert set(found.circuits) == {1, 2}
    assert found.circuits[2].wiring.sensors == PAIR
    assert found.circuits[2].held_out.rmse_degC < 0.5 * found.circuits[1].held_out.rmse_degC
    assert found.circuits[2].tried > 10


def test_what_was_found_holds_on_another_run(found):
    check = found.checks[0]
    assert check.path == AGAIN.path
    assert check.filters[1] < 2 * found.sizes[1].held_out.rmse_degC
    assert check.circuits[2] < 0.5 * check.circuits[1]
    assert check.against is not None
    assert check.against[0] > 3 * check.filters[1]


def test_two_processes_find_what_one_finds(found):
    again = found_in(made_up(), 2, [AGAIN])
    assert as_json(again) == as_json(found)


def test_a_double_is_named_as_an_alternative():
    trace = made_up()
    noise = np.random.default_rng(9).normal(scale=0.02, size=len(trace.time_s))
    trace.columns["copy_degC"] = np.round(trace.columns["right_degC"] + noise, 2)
    found = found_in(trace, 1, with_circuits=False)
    assert set(found.sizes[1].sensors) in ({"left", "right"}, {"left", "copy"})
    own = next(each for each in found.sizes[1].sensors if each != "left")
    other = "copy" if own == "right" else "right"
    assert (own, other) in {(each.out, each.into) for each in found.sizes[1].alternatives}
    assert [line for line in findings(found) if line.startswith(f"{own} or {other}")]


def test_results_that_are_known_are_not_computed_again():
    state = State(None, {})
    trace = made_up()
    data = prepared([trace], screened([trace]), OPTIONS)
    computed = []
    for _ in range(2):
        with Work(1, state, lambda *_: None) as work:
            searched(data, OPTIONS, work, with_circuits=False)
            computed.append(work.computed)
    assert computed[0] > 10
    assert computed[1] == 0


def test_several_traces_are_searched_together():
    traces = [made_up(0), made_up(1, path="other.csv")]
    data = prepared(traces, screened(traces), OPTIONS)
    assert {each.segment for each in data.blocks} == {0, 1}
    with Work(1, State(None, {}), lambda *_: None) as work:
        found = searched(data, OPTIONS, work, with_circuits=False)
    assert found.sizes[1].sensors == PAIR
    assert found.traces == ("made-up.csv", "other.csv")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda columns: columns.pop("ambient_degC"), "no column 'ambient_degC'"),
        (lambda columns: columns.update(ambient_degC=np.full(1500, 20.0)), "never changes; log a run in which"),
        (lambda columns: columns.update(ambient_degC=np.full(1500, np.nan)), "never changes; log a run in which"),
    ],
)
def test_a_trace_that_cannot_teach_is_refused(change, said):
    trace = made_up()
    change(trace.columns)
    with pytest.raises(Refused, match=said):
        prepared([trace], screened([trace]), Options())


def test_a_trace_without_any_usable_zone_is_refused():
    trace = made_up()
    columns = {"flat_degC": np.full(1500, 3.0), "ambient_degC": trace.reference}
    with pytest.raises(Refused, match=r"no zone can teach anything \(flat_degC: constant: 3 degC all the time\)"):
        prepared([replace(trace, columns=columns)], screened([replace(trace, columns=columns)]), Options())


def test_a_trace_to_check_on_is_looked_at_before_the_work():
    trace = made_up()
    data = prepared([trace], screened([trace]), OPTIONS)
    lacking = made_up(3, path="lacking.csv")
    del lacking.columns["chip_degC"], lacking.columns["right_degC"]
    blind = made_up(3, path="blind.csv")
    blind.columns["ambient_degC"][:] = np.nan
    with Work(1, State(None, {}), lambda *_: None) as work:
        with pytest.raises(
            Refused, match=r"lacking\.csv: line 1: no column chip_degC, right_degC; check a trace of the"
        ):
            searched(data, OPTIONS, work, checks=[lacking])
        with pytest.raises(Refused, match=r"blind\.csv: column ambient_degC: holds no value at all"):
            searched(data, OPTIONS, work, checks=[blind])
        assert work.computed == 0


def test_too_few_samples_are_refused():
    trace = made_up().cut(None, 100.0)
    with pytest.raises(Refused, match="50 samples for up to 26 unknowns; log 10 each, or ask for fewer sensors"):
        prepared([trace], screened([trace]), Options())


def test_a_set_to_compare_with_has_to_be_there():
    trace = made_up()
    trace.columns["flat_degC"] = np.full(1500, 3.0)
    data = prepared([trace], screened([trace]), Options())
    with pytest.raises(Refused, match="skin: no such sensor"):
        data.numbers(["skin"])
    with pytest.raises(Refused, match="flat: left out: constant"):
        data.numbers(["flat"])
