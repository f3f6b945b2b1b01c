import copy
import json
import math
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.codec import decode, encode, load_model, save_model
from ambient_model.conformance import worst_difference_degC
from ambient_model.faults import Refused
from ambient_model.model import Conformance, Discrete, ErrorVariance, Estimator, Input, Model, Secondary, Term

FROZEN = Path(__file__).parents[1] / "data" / "model-v1.json"
FROZEN_GUARDED = Path(__file__).parents[1] / "data" / "model-v1-guard.json"
AGAIN = "export the model again with 'ambient-trainer fit'"
NUMBER = "a finite number is wanted"
TEXT = "a text of printable characters is wanted"

USB = Input("usb", "degC", "usb-therm", -20.0, 80.0)
BATTERY = Input("battery", "degC", "battery", -20.0, 60.0)
PHONE = Model(
    name="phone",
    created="2024-05-01T12:00:00Z",
    output="ambient_degC",
    main=Estimator(
        inputs=(USB, BATTERY),
        states=("case", "core"),
        discrete=(
            Discrete(
                1.0,
                A=((0.5, 0.25), (0.0, 0.75)),
                B=((0.25, 0.0), (0.125, 0.125)),
                C=((0.5, -0.25),),
                D=((0.25, 0.5),),
            ),
            Discrete(
                0.5,
                A=((0.75, 0.125), (0.0, 0.875)),
                B=((0.125, 0.0), (0.0625, 0.0625)),
                C=((0.5, -0.25),),
                D=((0.25, 0.5),),
            ),
        ),
        offset=-1.5,
        initial=((0.75, 0.25), (0.5, 0.5)),
        interval={50: (-0.25, 0.25), 90: (-0.5, 0.75), 98: (-1.0, 1.25)},
    ),
    fallbacks={
        "battery": Estimator(
            inputs=(USB,),
            states=("case",),
            discrete=(
                Discrete(1.0, A=((0.5,),), B=((0.5,),), C=((0.25,),), D=((0.5,),)),
                Discrete(0.5, A=((0.75,),), B=((0.25,),), C=((0.25,),), D=((0.5,),)),
            ),
            offset=2.0,
            initial=((1.0,),),
            interval={50: (-0.5, 0.5), 90: (-1.0, 1.5), 98: (-2.0, 2.5)},
        )
    },
    provenance={"circuit": "free-2", "traces": [{"path": "rest.csv", "sha256": "0" * 64}], "rmse_degC": 0.375},
    conformance=Conformance(
        inputs=((32.0, 28.0), (32.0, 28.0), (40.0, 28.0), (40.0, 36.0)),
        outputs={1.0: (28.5, 28.5, 30.5, 35.25), 0.5: (28.5, 28.5, 30.5, 34.875)},
    ),
)
TERMS = (Term("movement", 300.0, 0.5), Term("movement", 60.0, 12.0), Term("guard", 120.0, 0.25))
GUARDED = PHONE._replace(
    secondary=Secondary(
        Estimator(
            inputs=(USB, BATTERY),
            states=("usb lagged",),
            discrete=(
                Discrete(1.0, A=((0.5,),), B=((0.5, 0.0),), C=((0.25,),), D=((0.5, 0.25),)),
                Discrete(0.5, A=((0.75,),), B=((0.25, 0.0),), C=((0.25,),), D=((0.5, 0.25),)),
            ),
            offset=-2.0,
            initial=((1.0, 0.0),),
            interval={50: (-0.5, 0.5), 90: (-1.0, 1.5), 98: (-2.0, 2.5)},
        ),
        threshold_degC=1.5,
    ),
    error_variance=ErrorVariance(
        constant_degC2=0.0625,
        terms=TERMS,
        quantiles={50: (-0.625, 0.75), 90: (-1.5, 1.75), 98: (-2.5, 2.25)},
    ),
)


def test_a_version_1_file_reads_the_same_for_ever() -> None:
    """The file was written by version 1 and is never to be written again: devices hold such files."""
    model = load_model(str(FROZEN))
    assert model == PHONE
    assert [each.column for each in model.main.inputs] == ["usb_degC", "battery_degC"]
    assert worst_difference_degC(model) == 0.0
    assert (model.secondary, model.error_variance) == (None, None)


def test_a_version_1_file_with_guard_and_spread_reads_the_same_for_ever() -> None:
    """The file was written when these keys came, and is never to be written again."""
    assert load_model(str(FROZEN_GUARDED)) == GUARDED


def test_a_model_without_guard_and_spread_is_written_as_before_they_came() -> None:
    """The daemon's state belongs to the model whose text it knows."""
    assert list(json.loads(encode(PHONE))) == list(document())


@given(st.from_type(Model))
def test_what_is_encoded_is_decoded(model: Model) -> None:
    assert decode(encode(model).encode(), "m.json") == model


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    path = str(tmp_path / "m.json")
    save_model(path, PHONE)
    assert load_model(path) == PHONE


def test_what_would_be_refused_is_not_saved(tmp_path: Path) -> None:
    main = PHONE.main._replace(offset=math.nan, initial=((math.inf, 0.25), (0.5, 0.5)))
    with pytest.raises(Refused) as refused:
        save_model(str(tmp_path / "m.json"), PHONE._replace(main=main))
    assert [fault.place for fault in refused.value.faults] == ["offset", "initial[0][0]"]
    assert os.listdir(tmp_path) == []


def document(frozen: Path = FROZEN) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(frozen.read_text())
    return data


GONE = object()
Edit = tuple[tuple[str | int, ...], Any]


def edited(*edits: Edit, frozen: Path = FROZEN) -> bytes:
    """The frozen file with the value at each path replaced, added or removed."""
    data = document(frozen)
    for (*way, last), value in edits:
        place: Any = data
        for step in way:
            place = place[step]
        if value is GONE:
            del place[last]
        elif isinstance(place, list) and last == len(place):
            place.append(copy.deepcopy(value))
        else:
            place[last] = copy.deepcopy(value)
    return json.dumps(data).encode()


def faults_of(content: bytes) -> list[str]:
    with pytest.raises(Refused) as refused:
        decode(content, "m.json")
    assert refused.value.source == "m.json"
    return [str(fault) for fault in refused.value.faults]


KEYS = (
    "known are format, version, name, created, output, inputs, states, discrete, offset, initial, interval, fallbacks, "
    "provenance, conformance, guard, spread"
)
VERSION = "and only 1 is known; export the model again, or update ambientd"
MODEL_FILE = "is this a model file?"
PERIOD = "a period lies between 0.001 and 86400 s"
COLUMN = "one per column is wanted"
UNSTABLE = "is unstable: an eigenvalue lies on or outside the unit circle; fit again; a passive circuit is stable"
A = ("discrete", 0, "A")

BROKEN: dict[str, tuple[list[Edit], list[str]]] = {
    "format": ([(("format",), "thermal")], [f"format: is 'thermal', not 'ambient-model'; {MODEL_FILE}"]),
    "format missing": ([(("format",), GONE)], [f"format: is nothing, not 'ambient-model'; {MODEL_FILE}"]),
    "version missing": ([(("version",), GONE)], [f"version: is nothing, {VERSION}"]),
    "version 2": ([(("version",), 2)], [f"version: is 2, {VERSION}"]),
    "version text": ([(("version",), "1")], [f"version: is '1', {VERSION}"]),
    "version true": ([(("version",), True)], [f"version: is True, {VERSION}"]),
    "version 1.0": ([(("version",), 1.0)], [f"version: is 1.0, {VERSION}"]),
    "unknown key": ([(("gain",), 1)], [f"gain: unknown key; {KEYS}"]),
    "unknown key in an input": (
        [(("inputs", 1, "max_degC"), 1)],
        ["inputs[1].max_degC: unknown key; known are name, unit, zone, min, max"],
    ),
    "unknown key in a period": (
        [(("discrete", 1, "E"), [])],
        ["discrete[1].E: unknown key; known are period_s, A, B, C, D"],
    ),
    "unknown level": ([(("interval", "95"), [0, 0])], ["interval.95: unknown key; known are 50, 90, 98"]),
    "unknown key in a fallback": (
        [(("fallbacks", 0, "name"), "x")],
        ["fallbacks[0].name: unknown key; known are without, inputs, states, discrete, offset, initial, interval"],
    ),
    "unknown key in conformance": (
        [(("conformance", "tolerance"), 0)],
        ["conformance.tolerance: unknown key; known are inputs, outputs"],
    ),
    "unknown key in an output": (
        [(("conformance", "outputs", 0, "unit"), "K")],
        ["conformance.outputs[0].unit: unknown key; known are period_s, values"],
    ),
    "missing key": ([(("offset",), GONE)], [f"offset: missing; {AGAIN}"]),
    "missing in an input": ([(("inputs", 0, "max"), GONE)], [f"inputs[0].max: missing; {AGAIN}"]),
    "missing in a period": ([(("discrete", 1, "B"), GONE)], [f"discrete[1].B: missing; {AGAIN}"]),
    "missing level": ([(("interval", "90"), GONE)], [f"interval.90: missing; {AGAIN}"]),
    "missing in a fallback": ([(("fallbacks", 0, "without"), GONE)], [f"fallbacks[0].without: missing; {AGAIN}"]),
    "missing in conformance": ([(("conformance", "outputs"), GONE)], [f"conformance.outputs: missing; {AGAIN}"]),
    "no object": ([(("interval",), [1])], ["interval: is a list; an object is wanted"]),
    "input no object": ([(("inputs", 1), 7)], ["inputs[1]: is a number; an object is wanted"]),
    "provenance no object": ([(("provenance",), None)], ["provenance: is nothing; an object is wanted"]),
    "no list": ([(("fallbacks",), {})], ["fallbacks: is an object; a list is wanted"]),
    "conformance no list": ([(("conformance", "inputs"), "x")], ["conformance.inputs: is a text; a list is wanted"]),
    "A a number": ([(A, 0.5)], ["discrete[0].A: is a number; a list is wanted"]),
    "A short": ([(A, [[0.5, 0.25]])], ["discrete[0].A: has 1 rows, not 2; the shape 2 x 2 is wanted"]),
    "A ragged": ([((*A, 1), [0.5])], [f"discrete[0].A[1]: has 1 numbers, not 2; {COLUMN}"]),
    "A flat": ([(A, [0.5, 0.5])], [f"discrete[0].A[{k}]: is a number; a list is wanted" for k in (0, 1)]),
    "B wide": ([(("discrete", 1, "B", 0), [1, 2, 3])], [f"discrete[1].B[0]: has 3 numbers, not 2; {COLUMN}"]),
    "C two rows": (
        [(("discrete", 0, "C"), [[0.5, 0.5], [0.5, 0.5]])],
        ["discrete[0].C: has 2 rows, not 1; the shape 1 x 2 is wanted"],
    ),
    "D empty": ([(("discrete", 0, "D"), [])], ["discrete[0].D: has 0 rows, not 1; the shape 1 x 2 is wanted"]),
    "initial": (
        [(("initial",), [[1, 0], [0, 1], [0, 0]])],
        ["initial: has 3 rows, not 2; the shape 2 x 2 is wanted"],
    ),
    "fallback's shape": (
        [(("fallbacks", 0, "initial", 0), [1, 2])],
        [f"fallbacks[0].initial[0]: has 2 numbers, not 1; {COLUMN}"],
    ),
    "NaN": ([(("offset",), math.nan)], [f"offset: is nan; {NUMBER}"]),
    "infinity": ([((*A, 0, 1), -math.inf)], [f"discrete[0].A[0][1]: is -inf; {NUMBER}"]),
    "true for 1": ([(("discrete", 0, "D", 0, 0), True)], [f"discrete[0].D[0][0]: is True; {NUMBER}"]),
    "text for a number": ([(("initial", 1, 0), "0.5")], [f"initial[1][0]: is '0.5'; {NUMBER}"]),
    "NaN in provenance": (
        [(("provenance", "traces", 0, "rmse_degC"), math.nan)],
        [f"provenance.traces[0].rmse_degC: is nan; {NUMBER}"],
    ),
    "eigenvalue 1": ([(A, [[1, 0], [0, 0.5]])], [f"discrete[0].A: {UNSTABLE}"]),
    "nothing is lost": ([(A, [[0.9, 0.1], [0.3, 0.7]])], [f"discrete[0].A: {UNSTABLE}"]),
    "complex pair": ([(A, [[0.8, -0.8], [0.8, 0.8]])], [f"discrete[0].A: {UNSTABLE}"]),
    "unstable fallback": (
        [(("fallbacks", 0, "discrete", 1, "A"), [[1.5]])],
        [f"fallbacks[0].discrete[1].A: {UNSTABLE}"],
    ),
    "period 0": ([(("discrete", 0, "period_s"), 0)], [f"discrete[0].period_s: is 0; {PERIOD}"]),
    "period negative": ([(("discrete", 1, "period_s"), -2)], [f"discrete[1].period_s: is -2; {PERIOD}"]),
    "period twice": (
        [(("discrete", 1, "period_s"), 1)],
        ["discrete: period 1 s stands twice; keep one"],
    ),
    "no periods": ([(("discrete",), [])], ["discrete: none; a model has coefficients for at least one period"]),
    "empty range": (
        [(("inputs", 0, "min"), 80)],
        ["inputs[0].min: is 80, not below max 80; give the range of plausible readings"],
    ),
    "empty name": ([(("name",), "")], [f"name: is ''; {TEXT}"]),
    "name of two lines": ([(("name",), "a\nb")], [rf"name: is 'a\nb'; {TEXT}"]),
    "name no text": ([(("states", 0), 5)], [f"states[0]: is 5; {TEXT}"]),
    "lone surrogate": ([(("inputs", 0, "zone"), "\ud800")], [rf"inputs[0].zone: is '\ud800'; {TEXT}"]),
    "state twice": ([(("states", 1), "case")], ["states: 'case' stands twice; each needs a name of its own"]),
    "input twice": ([(("inputs", 1, "name"), "usb")], ["inputs: 'usb' stands twice; each needs a name of its own"]),
    "interval upside down": (
        [(("interval", "50"), [0.25, -0.25])],
        ["interval.50: 0.25 lies above -0.25; the lower end stands first"],
    ),
    "interval of one number": ([(("interval", "50"), [0.25])], [f"interval.50: has 1 numbers, not 2; {COLUMN}"]),
    "interval not nested": (
        [(("interval", "90"), [-0.5, 0.125])],
        ["interval.90: does not contain the 50 % interval; a higher level is wider"],
    ),
    "conformance without a period": (
        [(("conformance", "outputs", 1), GONE)],
        ["conformance.outputs: the periods are not those of 'discrete'; one sequence per period is wanted"],
    ),
    "conformance of another period": (
        [(("conformance", "outputs", 1, "period_s"), 3)],
        ["conformance.outputs: the periods are not those of 'discrete'; one sequence per period is wanted"],
    ),
    "conformance twice": (
        [(("conformance", "outputs", 2), {"period_s": 1, "values": [0, 0, 0, 0]})],
        ["conformance.outputs: period 1 s stands twice; keep one"],
    ),
    "conformance too wide": (
        [(("conformance", "inputs"), [[1, 2, 3]] * 4)],
        ["conformance.inputs: 3 columns for 2 inputs; one per input is wanted"],
    ),
    "conformance ragged": (
        [(("conformance", "inputs", 2), [1])],
        [f"conformance.inputs[2]: has 1 numbers, not 2; {COLUMN}"],
    ),
    "conformance short": (
        [(("conformance", "outputs", 0, "values"), [28.5])],
        [f"conformance.outputs[0].values: has 1 numbers, not 4; {COLUMN}"],
    ),
    "conformance empty": (
        [
            (("conformance", "inputs"), []),
            (("conformance", "outputs", 0, "values"), []),
            (("conformance", "outputs", 1, "values"), []),
        ],
        ["conformance.inputs: none; a model file carries the sequence that proves a port of it right"],
    ),
    "fallback for a stranger": (
        [(("fallbacks", 0, "without"), "skin")],
        ["fallbacks[0].without: 'skin' is no input; inputs are usb, battery"],
    ),
    "fallback reads a stranger": (
        [(("fallbacks", 0, "inputs", 0, "name"), "skin")],
        ["fallbacks[0].inputs: without 'battery' reads skin; a fallback reads the other inputs, unchanged"],
    ),
    "fallback reads with another range": (
        [(("fallbacks", 0, "inputs", 0, "max"), 70)],
        ["fallbacks[0].inputs: without 'battery' reads usb; a fallback reads the other inputs, unchanged"],
    ),
    "fallback reads what is gone": (
        [(("fallbacks", 0, "without"), "usb")],
        ["fallbacks[0].inputs: without 'usb' reads usb; a fallback reads the other inputs, unchanged"],
    ),
    "fallback at another period": (
        [(("fallbacks", 0, "discrete", 1, "period_s"), 0.25)],
        ["fallbacks[0].discrete: the periods are not the model's; a fallback runs at the model's periods"],
    ),
    "fallback twice": (
        [(("fallbacks", 1), document()["fallbacks"][0])],
        ["fallbacks[1].without: 'battery' stands twice; keep one"],
    ),
    "no inputs": (
        [
            (("inputs",), []),
            (("discrete", 0, "B"), [[], []]),
            (("discrete", 0, "D"), [[]]),
            (("discrete", 1, "B"), [[], []]),
            (("discrete", 1, "D"), [[]]),
            (("initial",), [[], []]),
        ],
        ["inputs: none; a model reads at least one sensor"],
    ),
    "several at once": (
        [
            (("gain",), 1),
            (("created",), GONE),
            (("inputs", 0, "unit"), None),
            (("discrete", 0, "A", 0, 0), math.inf),
            (("discrete", 1, "period_s"), -1),
            (("fallbacks", 0, "interval", "98"), [0, 0]),
            (("conformance", "outputs", 1, "values"), None),
        ],
        [
            f"gain: unknown key; {KEYS}",
            f"created: missing; {AGAIN}",
            f"inputs[0].unit: is nothing; {TEXT}",
            f"discrete[0].A[0][0]: is inf; {NUMBER}",
            f"discrete[1].period_s: is -1; {PERIOD}",
            "fallbacks[0].interval.98: does not contain the 90 % interval; a higher level is wider",
            "conformance.outputs[1].values: is nothing; a list is wanted",
        ],
    ),
}


NOT_THE_MODELS = "the secondary estimator reads the model's inputs, in their order"
BROKEN_GUARDED: dict[str, tuple[list[Edit], list[str]]] = {
    "guard null": ([(("guard",), None)], ["guard: is nothing; an object is wanted"]),
    "guard no object": ([(("guard",), [1])], ["guard: is a list; an object is wanted"]),
    "guard empty": (
        [(("guard",), {})],
        [
            f"guard.{key}: missing; {AGAIN}"
            for key in ("threshold_degC", "inputs", "states", "discrete", "offset", "initial", "interval")
        ],
    ),
    "unknown key in the guard": (
        [(("guard", "name"), "x")],
        ["guard.name: unknown key; known are threshold_degC, inputs, states, discrete, offset, initial, interval"],
    ),
    "threshold 0": ([(("guard", "threshold_degC"), 0)], ["guard.threshold_degC: is 0; more than 0 is wanted"]),
    "threshold negative": (
        [(("guard", "threshold_degC"), -1.5)],
        ["guard.threshold_degC: is -1.5; more than 0 is wanted"],
    ),
    "threshold infinite": (
        [(("guard", "threshold_degC"), math.inf)],
        [f"guard.threshold_degC: is inf; {NUMBER}"],
    ),
    "threshold a text": ([(("guard", "threshold_degC"), "1")], [f"guard.threshold_degC: is '1'; {NUMBER}"]),
    "guard's shape": (
        [(("guard", "discrete", 1, "B", 0), [0.25])],
        [f"guard.discrete[1].B[0]: has 1 numbers, not 2; {COLUMN}"],
    ),
    "guard unstable": (
        [(("guard", "discrete", 0, "A"), [[-1.25]])],
        [f"guard.discrete[0].A: {UNSTABLE}"],
    ),
    "guard reads less": (
        [
            (("guard", "inputs", 1), GONE),
            (("guard", "initial"), [[1]]),
            *[
                edit
                for k in (0, 1)
                for edit in ((("guard", "discrete", k, "B"), [[0.5]]), (("guard", "discrete", k, "D"), [[0.5]]))
            ],
        ],
        [f"guard.inputs: are not the model's; {NOT_THE_MODELS}"],
    ),
    "guard reads with another range": (
        [(("guard", "inputs", 1, "max"), 61)],
        [f"guard.inputs: are not the model's; {NOT_THE_MODELS}"],
    ),
    "guard reads in another order": (
        [(("guard", "inputs"), document()["inputs"][::-1])],
        [f"guard.inputs: are not the model's; {NOT_THE_MODELS}"],
    ),
    "guard at another period": (
        [(("guard", "discrete", 1, "period_s"), 0.25)],
        ["guard.discrete: the periods are not the model's; it runs at the model's periods"],
    ),
    "spread null": ([(("spread",), None)], ["spread: is nothing; an object is wanted"]),
    "spread empty": (
        [(("spread",), {})],
        [f"spread.{key}: missing; {AGAIN}" for key in ("constant_degC2", "terms", "quantiles")],
    ),
    "unknown key in the spread": (
        [(("spread", "floor"), 1)],
        ["spread.floor: unknown key; known are constant_degC2, terms, quantiles"],
    ),
    "constant negative": (
        [(("spread", "constant_degC2"), -0.25)],
        ["spread.constant_degC2: is -0.25; 0 or more is wanted"],
    ),
    "constant NaN": ([(("spread", "constant_degC2"), math.nan)], [f"spread.constant_degC2: is nan; {NUMBER}"]),
    "weight negative": (
        [(("spread", "terms", 1, "weight"), -1)],
        ["spread.terms[1].weight: is -1; 0 or more is wanted"],
    ),
    "weight infinite": (
        [(("spread", "terms", 2, "weight"), math.inf)],
        [f"spread.terms[2].weight: is inf; {NUMBER}"],
    ),
    "lag 0": ([(("spread", "terms", 0, "lag_s"), 0)], ["spread.terms[0].lag_s: is 0; more than 0 is wanted"]),
    "lag huge": (
        [(("spread", "terms", 0, "lag_s"), 1e13)],
        ["spread.terms[0].lag_s: is 10000000000000.0; at most 1e+12 is wanted"],
    ),
    "of a stranger": (
        [(("spread", "terms", 0, "of"), "wind")],
        ["spread.terms[0].of: is 'wind'; known are movement, guard"],
    ),
    "of a number": ([(("spread", "terms", 0, "of"), 1)], [f"spread.terms[0].of: is 1; {TEXT}"]),
    "term no object": ([(("spread", "terms", 0), 0.5)], ["spread.terms[0]: is a number; an object is wanted"]),
    "unknown key in a term": (
        [(("spread", "terms", 0, "unit"), "K")],
        ["spread.terms[0].unit: unknown key; known are of, lag_s, weight"],
    ),
    "terms no list": ([(("spread", "terms"), {})], ["spread.terms: is an object; a list is wanted"]),
    "too many terms": (
        [(("spread", "terms"), [{"of": "movement", "lag_s": 1, "weight": 1}] * 9)],
        ["spread.terms: has 9 entries; at most 8 are wanted"],
    ),
    "quantiles not nested": (
        [(("spread", "quantiles", "98"), [-0.5, 2.25])],
        ["spread.quantiles.98: does not contain the 90 % interval; a higher level is wider"],
    ),
    "quantile missing": ([(("spread", "quantiles", "50"), GONE)], [f"spread.quantiles.50: missing; {AGAIN}"]),
    "of a guard that is not there": (
        [(("guard",), GONE)],
        ["spread.terms[2].of: is 'guard', and there is none; add the key 'guard'"],
    ),
    "guard and spread at once": (
        [(("guard", "offset"), None), (("guard", "threshold_degC"), 0), (("spread", "terms", 0, "weight"), -1)],
        [
            f"guard.offset: is nothing; {NUMBER}",
            "guard.threshold_degC: is 0; more than 0 is wanted",
            "spread.terms[0].weight: is -1; 0 or more is wanted",
        ],
    ),
}


@pytest.mark.parametrize("case", BROKEN_GUARDED)
def test_a_broken_guard_or_spread_is_refused_with_every_fault_and_its_path(case: str) -> None:
    edits, faults = BROKEN_GUARDED[case]
    assert faults_of(edited(*edits, frozen=FROZEN_GUARDED)) == faults


def test_guard_and_spread_come_alone_too() -> None:
    alone = decode(edited((("spread",), GONE), frozen=FROZEN_GUARDED), "m.json")
    assert alone == GUARDED._replace(error_variance=None)
    alone = decode(edited((("guard",), GONE), (("spread", "terms", 2), GONE), frozen=FROZEN_GUARDED), "m.json")
    assert alone == GUARDED._replace(
        secondary=None, error_variance=GUARDED.error_variance and GUARDED.error_variance._replace(terms=TERMS[:2])
    )


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_refused_with_every_fault_and_its_path(case: str) -> None:
    edits, faults = BROKEN[case]
    assert faults_of(edited(*edits)) == faults


def test_each_top_level_key_is_needed() -> None:
    for key in document():
        if key not in ("format", "version"):
            assert faults_of(edited(((key,), GONE)))[0] == f"{key}: missing; {AGAIN}"


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999", "9" * 400, "-" + "9" * 5000])
def test_what_no_float_holds_is_refused_by_its_place(text: str) -> None:
    content = FROZEN.read_bytes().replace(b'"offset": -1.5', b'"offset": ' + text.encode())
    value = {"NaN": "nan"}.get(text, "-inf" if text[0] == "-" else "inf")
    assert faults_of(content) == [f"offset: is {value}; {NUMBER}"]


@pytest.mark.parametrize("text", ["1000000000001", "-1e300", "1" + "0" * 200])
def test_what_a_recursion_may_carry_beyond_any_float_is_refused(text: str) -> None:
    content = FROZEN.read_bytes().replace(b'"offset": -1.5', b'"offset": ' + text.encode())
    [fault] = faults_of(content)
    assert fault.startswith(f"offset: is {text[:1]}")
    assert fault.endswith("; at most 1e+12 is wanted")


def test_an_integer_is_a_number() -> None:
    content = FROZEN.read_bytes().replace(b'"offset": -1.5', b'"offset": -1000000000000')
    assert decode(content, "m.json").main.offset == -1e12


@pytest.mark.parametrize("slow", [[[1 - 1e-7, 0], [0, 0.5]], [[1 - 1e-7, 1e-7], [0, 1 - 2e-7]]])
def test_a_slow_circuit_is_stable(slow: list[list[float]]) -> None:
    assert tuple(map(tuple, slow)) == decode(edited((A, slow)), "m.json").main.discrete[0].A


WHOLE = {
    "empty": (b"", f"the file is empty; {AGAIN}"),
    "blank": (b" \n", f"the file is empty; {AGAIN}"),
    "list": (b"[]", "holds a list, not an object; is this a model file?"),
    "text": (b'"x"', "holds a text, not an object; is this a model file?"),
    "not JSON": (b"{a", "line 1, column 2: not JSON (Expecting property name enclosed in double quotes); " + AGAIN),
    "not UTF-8": (
        b'{"\xff"}',
        "not JSON ('utf-8' codec can't decode byte 0xff in position 2: invalid start byte); " + AGAIN,
    ),
    "deep": (b"[" * 200_000, None),
    "deep object": (b'{"a":' * 200_000, None),
    "key twice": (b'{"format": "a", "format": "b"}', f"not JSON (key 'format' stands twice in one object); {AGAIN}"),
    "large": (b" " * (2**20 + 1), "larger than 1 MiB; a model file is some kilobytes: is this one?"),
}


@pytest.mark.parametrize("case", WHOLE)
def test_what_is_no_model_file(case: str) -> None:
    content, message = WHOLE[case]
    [fault] = faults_of(content)
    if message is None:
        assert fault.startswith("not JSON (")  # the parser's own words for too deep differ between versions
        return
    cut = "is it cut off? export the model again"
    assert fault == (message.replace(AGAIN, cut) if case == "not JSON" else message)


def test_a_key_that_stands_twice_deep_inside() -> None:
    content = FROZEN.read_bytes().replace(b'"unit": "degC"', b'"unit": "degC", "unit": "K"', 1)
    assert faults_of(content) == [f"not JSON (key 'unit' stands twice in one object); {AGAIN}"]


def test_a_file_cut_off_anywhere_is_refused() -> None:
    content = FROZEN.read_bytes().rstrip()
    for length in range(0, len(content), 3):
        [fault] = faults_of(content[:length])
        assert fault.startswith("line ") or length == 0


@pytest.mark.parametrize("reason", ["No such file or directory", "Is a directory"])
def test_what_cannot_be_opened(tmp_path: Path, reason: str) -> None:
    path = tmp_path if reason == "Is a directory" else tmp_path / "m.json"
    with pytest.raises(Refused) as refused:
        load_model(str(path))
    assert str(refused.value) == f"{path}: cannot be read ({reason}); check the name and the permissions"


def model_or_refused(content: bytes) -> None:
    """A model that is encoded and decoded to itself, or a refusal that can be shown."""
    try:
        model = decode(content, "m.json")
    except Refused as refused:
        str(refused)
    else:
        assert decode(encode(model).encode(), "m.json") == model


@given(st.binary(max_size=100))
def test_arbitrary_bytes_are_a_model_or_refused(content: bytes) -> None:
    model_or_refused(content)


@given(st.data())
@settings(max_examples=200)
def test_damaged_bytes_are_a_model_or_refused(data: st.DataObject) -> None:
    content = FROZEN.read_bytes()
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content)))
        piece = data.draw(st.binary(max_size=3) | st.sampled_from([b"]", b"[", b"{", b"}", b",", b"1e999", b"-", b'"']))
        content = content[:at] + piece + content[at + data.draw(st.integers(0, 4)) :]
    model_or_refused(content)


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@given(st.data())
@settings(max_examples=300)
def test_a_document_with_anything_anywhere_is_a_model_or_refused(data: st.DataObject) -> None:
    whole: Any = document(data.draw(st.sampled_from([FROZEN, FROZEN_GUARDED])))
    place = whole
    while True:
        key = data.draw(st.sampled_from(list(place) if isinstance(place, dict) else range(len(place))))
        if not isinstance(place[key], (dict, list)) or not place[key] or data.draw(st.booleans()):
            break
        place = place[key]
    place[key] = data.draw(anything)
    model_or_refused(json.dumps(whole).encode())
