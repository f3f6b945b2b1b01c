import json
import math
import os
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.codec import decode, encode, load_model, save_model
from ambient_model.conformance import worst_difference_degC
from ambient_model.faults import Fault, Refused
from ambient_model.model import Discrete, ErrorVariance, Input, Model, Term
from documents import Way, at, damaged
from refusals import refused, refused_places

FROZEN = Path(__file__).parents[1] / "data" / "model-v1.json"
FROZEN_GUARDED = Path(__file__).parents[1] / "data" / "model-v1-guard.json"

USB = Input("usb", "degC", "usb-therm", -20.0, 80.0)
BATTERY = Input("battery", "degC", "battery", -20.0, 60.0)
TERMS = (Term("movement", 300.0, 0.5), Term("movement", 60.0, 12.0), Term("guard", 120.0, 0.25))
PHONE, GUARDED = load_model(str(FROZEN)), load_model(str(FROZEN_GUARDED))


def test_a_version_1_file_reads_the_same_for_ever() -> None:
    """The file was written by version 1 and is never to be written again: devices hold such files."""
    main, fallback = PHONE.main, PHONE.fallbacks["battery"]
    assert (PHONE.name, PHONE.output, main.states) == ("phone", "ambient_degC", ("case", "core"))
    assert (main.inputs, fallback.inputs) == ((USB, BATTERY), (USB,))
    assert [each.column for each in main.inputs] == ["usb_degC", "battery_degC"]
    A, B = ((0.5, 0.25), (0.0, 0.75)), ((0.25, 0.0), (0.125, 0.125))
    assert main.discrete[0] == Discrete(1.0, A, B, C=((0.5, -0.25),), D=((0.25, 0.5),))
    assert (main.offset, main.initial, fallback.offset) == (-1.5, ((0.75, 0.25), (0.5, 0.5)), 2.0)
    assert main.interval == {50: (-0.25, 0.25), 90: (-0.5, 0.75), 98: (-1.0, 1.25)}
    assert PHONE.provenance["traces"] == [{"path": "rest.csv", "sha256": "0" * 64}]
    assert worst_difference_degC(PHONE) == 0.0
    assert (PHONE.secondary, PHONE.error_variance) == (None, None)
    # the keys in their order, too: the daemon's state belongs to the model whose text it knows
    assert list(json.loads(encode(PHONE)).items()) == list(document().items())


def test_a_version_1_file_with_guard_and_spread_reads_the_same_for_ever() -> None:
    """The file was written when these keys came, and is never to be written again."""
    quantiles = {50: (-0.625, 0.75), 90: (-1.5, 1.75), 98: (-2.5, 2.25)}
    assert GUARDED.error_variance == ErrorVariance(0.0625, TERMS, quantiles)
    second = GUARDED.secondary.estimator
    assert (GUARDED.secondary.threshold_degC, second.inputs, second.offset) == (1.5, (USB, BATTERY), -2.0)
    assert GUARDED._replace(secondary=None, error_variance=None) == PHONE
    assert json.loads(encode(GUARDED)) == document(FROZEN_GUARDED)


@given(st.from_type(Model))
def test_what_is_encoded_is_decoded(model: Model) -> None:
    assert decode(encode(model).encode(), "m.json") == model


def test_what_is_saved_is_loaded_and_what_would_be_refused_is_not_saved(saved, tmp_path: Path) -> None:
    assert load_model(saved(PHONE)) == PHONE
    os.remove(tmp_path / "model.json")
    for path, reason in ((tmp_path, "Is a directory"), (tmp_path / "m.json", "No such file or directory")):
        assert re.match(f"{path}: .*{reason}", str(refused(load_model, str(path))))
    main = PHONE.main._replace(offset=math.nan, initial=((math.inf, 0.25), (0.5, 0.5)))
    places = refused_places(save_model, str(tmp_path / "m.json"), PHONE._replace(main=main))
    assert places == ["offset", "initial[0][0]"]
    assert os.listdir(tmp_path) == []


def document(frozen: Path = FROZEN) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(frozen.read_text())
    return data


# One broken file a line: the values that are replaced, "PATH=JSON" (empty removes it; @PATH*N repeats what is there, -1
# reverses it), and the places of the faults, where they are not the path itself.
BROKEN = r"""
format="thermal"
format=
version=
version=2
version="1"
version=true
version=1.0
inputs[1].max_degC=1
discrete[1].E=[]
interval.95=[0,0]
fallbacks[0].name="x"
conformance.tolerance=0
conformance.outputs[0].unit="K"
offset=
inputs[0].max=
discrete[1].B=
interval.90=
fallbacks[0].without=
conformance.outputs=
interval=[1]
inputs[1]=7
provenance=null
fallbacks={}
conformance.inputs="x"
discrete[0].A=0.5
discrete[0].A=[[0.5,0.25]]
discrete[0].A[1]=[0.5]
discrete[0].A=[0.5,0.5] -> discrete[0].A[0] discrete[0].A[1]
discrete[1].B[0]=[1,2,3]
discrete[0].C=[[0.5,0.5],[0.5,0.5]]
discrete[0].D=[]
initial=[[1,0],[0,1],[0,0]]
fallbacks[0].initial[0]=[1,2]
discrete[0].D[0][0]=true
discrete[0].A[0][1]=-Infinity
initial[1][0]="0.5"
provenance.traces[0].rmse_degC=NaN
discrete[0].A=[[1,0],[0,0.5]]
fallbacks[0].discrete[1].A=[[1.5]]
discrete[0].period_s=0
discrete[1].period_s=1 -> discrete
discrete=[]
inputs[0].min=80
name=""
name="a\nb"
states[0]=5
inputs[0].zone="\ud800"
states[1]="case" -> states
inputs[1].name="usb" -> inputs
interval.50=[0.25,-0.25]
interval.50=[0.25]
interval.90=[-0.5,0.125]
conformance.outputs[1]= -> conformance.outputs
conformance.outputs[1].period_s=3 -> conformance.outputs
conformance.outputs[2]={"period_s":1,"values":[0,0,0,0]} -> conformance.outputs
conformance.inputs=[[1,2,3],[1,2,3],[1,2,3],[1,2,3]]
conformance.inputs[2]=[1]
conformance.outputs[0].values=[28.5]
conformance.inputs=[] & conformance.outputs[0].values=[] & conformance.outputs[1].values=[] -> conformance.inputs
fallbacks[0].without="skin"
fallbacks[0].inputs[0].name="skin" -> fallbacks[0].inputs
fallbacks[0].inputs[0].max=70 -> fallbacks[0].inputs
fallbacks[0].without="usb" -> fallbacks[0].inputs
fallbacks[0].discrete[1].period_s=0.25 -> fallbacks[0].discrete
fallbacks=@fallbacks*2 -> fallbacks[1].without
inputs=[] & discrete[0].B=[[],[]] & discrete[0].D=[[]] & discrete[1].B=[[],[]] & discrete[1].D=[[]] & \
    initial=[[],[]] -> inputs
gain=1 & created= & inputs[0].unit=null & discrete[0].A[0][0]=Infinity & discrete[1].period_s=-1 & \
    fallbacks[0].interval.98=[0,0] & conformance.outputs[1].values=null -> gain created inputs[0].unit \
    discrete[0].A[0][0] discrete[1].period_s fallbacks[0].interval.98 conformance.outputs[1].values
"""
BROKEN_GUARDED = r"""
guard=null
guard=[1]
guard={} -> guard.threshold_degC guard.inputs guard.states guard.discrete guard.offset guard.initial guard.interval
guard.name="x"
guard.threshold_degC=Infinity
guard.threshold_degC=-1.5
guard.threshold_degC="1"
guard.discrete[1].B[0]=[0.25]
guard.discrete[0].A=[[-1.25]]
guard.inputs[1]= & guard.initial=[[1]] & guard.discrete[0].B=[[0.5]] & guard.discrete[0].D=[[0.5]] & \
    guard.discrete[1].B=[[0.5]] & guard.discrete[1].D=[[0.5]] -> guard.inputs
guard.inputs[1].max=61 -> guard.inputs
guard.inputs=@guard.inputs*-1
guard.discrete[1].period_s=0.25 -> guard.discrete
spread=null
spread={} -> spread.constant_degC2 spread.terms spread.quantiles
spread.floor=1
spread.constant_degC2=-0.25
spread.constant_degC2=NaN
spread.terms[2].weight=Infinity
spread.terms[0].lag_s=0
spread.terms[0].lag_s=10000000000000.0
spread.terms[0].of="wind"
spread.terms[0].of=1
spread.terms[0]=0.5
spread.terms[0].unit="K"
spread.terms={}
spread.terms=@spread.terms*3
spread.quantiles.98=[-0.5,2.25]
spread.quantiles.50=
guard= & spread.terms[0].of="guard_below" -> spread.terms[0].of spread.terms[2].of
guard.offset=null & guard.threshold_degC=0 & spread.terms[0].weight=-1 -> guard.offset guard.threshold_degC \
    spread.terms[0].weight
"""


def cases(table: str, frozen: Path) -> list[Any]:
    lines = re.sub(r" \\\n +", " ", table.strip()).splitlines()
    return [pytest.param(*line.partition(" -> ")[::2], frozen, id=line[:60]) for line in lines]


def steps(path: str) -> Way:
    return tuple(int(index) if index else name for index, name in re.findall(r"\[(\d+)\]|([^.\[\]]+)", path))


def edited(edits: str, frozen: Path = FROZEN) -> bytes:
    """The frozen file with the value at each path replaced, added or removed."""
    data = document(frozen)
    for edit in edits.split(" & "):
        path, _, text = edit.partition("=")
        *way, last = steps(path)
        place: Any = at(data, tuple(way))
        if text.startswith("@"):
            value, count = at(data, steps(text[1:].partition("*")[0])), int(text.partition("*")[2])
            place[last] = value[::-1] if count < 0 else value * count
        elif not text:
            del place[last]
        elif isinstance(place, list) and last == len(place):
            place.append(json.loads(text))
        else:
            place[last] = json.loads(text)
    return json.dumps(data).encode()


def faults_of(content: bytes) -> list[Fault]:
    refusal = refused(decode, content, "m.json")
    assert refusal.source == "m.json"
    assert all(fault.problem and fault.hint for fault in refusal.faults)
    return list(refusal.faults)


@pytest.mark.parametrize(
    ("edits", "places", "frozen"), [*cases(BROKEN, FROZEN), *cases(BROKEN_GUARDED, FROZEN_GUARDED)]
)
def test_a_broken_file_is_refused_with_the_place_of_every_fault(edits: str, places: str, frozen: Path) -> None:
    found = [fault.place for fault in faults_of(edited(edits, frozen))]
    assert found == (places.split() or [edits.partition("=")[0]])


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        *[("NaN", "nan"), ("Infinity", "inf"), ("-Infinity", "-inf"), ("1e999", "inf"), ("9" * 400, "inf")],
        *[("-" + "9" * 5000, "-inf"), ("1000000000001", "1000000000001"), ("-1e300", "-1e+300")],
    ],
)
def test_what_no_recursion_may_carry_is_refused_by_its_place(text: str, shown: str) -> None:
    [fault] = faults_of(FROZEN.read_bytes().replace(b'"offset": -1.5', b'"offset": ' + text.encode()))
    assert fault.place == "offset"
    assert f"is {shown}" in fault.problem


def test_the_largest_integer_is_a_number_and_a_slow_circuit_is_stable() -> None:
    content = FROZEN.read_bytes().replace(b'"offset": -1.5', b'"offset": -1000000000000')
    assert decode(content, "m.json").main.offset == -1e12
    for slow in ([[1 - 1e-7, 0], [0, 0.5]], [[1 - 1e-7, 1e-7], [0, 1 - 2e-7]]):
        model = decode(edited(f"discrete[0].A={json.dumps(slow)}"), "m.json")
        assert tuple(map(tuple, slow)) == model.main.discrete[0].A


@pytest.mark.parametrize(
    ("content", "fact"),
    [
        *[(b"", "empty"), (b" \n", "empty"), (b"[]", "a list"), (b'"x"', "a text"), (b"{a", "line 1, column 2")],
        *[(b'{"\xff"}', "0xff"), (b"[" * 200_000, "not JSON"), (b'{"a":' * 200_000, "not JSON")],
        (b'{"format": "a", "format": "b"}', "'format'"),
        (FROZEN.read_bytes().replace(b'"unit": "degC"', b'"unit": "degC", "unit": "K"', 1), "'unit'"),
        (b" " * (2**20 + 1), "1 MiB"),
    ],
    ids=range(11),
)
def test_what_is_no_model_file(content: bytes, fact: str) -> None:
    [fault] = faults_of(content)
    assert fact in str(fault)


def test_a_file_cut_off_anywhere_is_refused() -> None:
    content = FROZEN.read_bytes().rstrip()
    for length in range(1, len(content), 3):
        [fault] = faults_of(content[:length])
        assert fault.place.startswith("line ")


@given(st.sampled_from([FROZEN, FROZEN_GUARDED]).flatmap(lambda frozen: damaged(document(frozen))))
@settings(max_examples=300)
def test_a_document_with_anything_anywhere_is_a_model_or_refused(data: Any) -> None:
    try:
        model = decode(json.dumps(data).encode(), "m.json")
    except Refused as refused:
        str(refused)
    else:
        assert decode(encode(model).encode(), "m.json") == model
