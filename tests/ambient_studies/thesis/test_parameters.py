"""The published parameters are the text's, and the circuits start where the thesis's fits did."""

from __future__ import annotations

import re

import pytest

from ambient_model.faults import Refused
from ambient_studies.thesis.methods import MODELS
from ambient_studies.thesis.parameters import parse_parameters, published_parameters
from ambient_trainer.circuits.schema import load_circuit

GREY_BOX = ("model1_ss", "model1_ss_single_input", "model2_ss", "model2_ss_single_input", "model2_ss_free_cd")
"""Tables 4.2 to 4.6, in order."""

NODES = {"soc": "soc", "disp": "display", "flash": "flash", "batt": "battery", "usb": "usb", "amb": "ambient"}


def _name(printed):
    """``R _{batt,amb}`` is R_battery_ambient, ``<i>w</i> ₁`` is w1."""
    bare = re.sub(r"<[^>]*>|[^A-Za-z0-9]", "", printed.translate(str.maketrans("₁₂₃₄₅₆₇", "1234567")))
    if bare[0] in "wW":
        return bare.lower()
    return "_".join([bare[0], *(NODES[each] for each in re.findall("|".join(NODES), bare[1:]))])


def _number(printed):
    power = re.fullmatch(r"\$(.*) \\cdot 10\^\{?(\d)\}?\$", printed)
    return float(f"{power[1]}e{power[2]}") if power else float(printed)


@pytest.fixture
def grey_box_tables(thesis_file):
    """By model the rows (name, free, range, initial, estimated) of tables 4.2 to 4.6."""
    found = re.findall(r"^(.+)\t(yes|no)\t(.+)\t(.+)\t(.+)$", thesis_file("thesis.txt"), re.MULTILINE | re.IGNORECASE)
    tables, rows = {}, iter(found)
    for model, length in zip(GREY_BOX, (12, 9, 12, 9, 16)):
        tables[model] = [next(rows) for _ in range(length)]
    assert next(rows, None) is None
    return tables


@pytest.mark.parametrize("model", GREY_BOX)
def test_tables_4_2_to_4_6_are_the_texts(grey_box_tables, model):
    printed = {_name(name): _number(estimated) for name, _, _, _, estimated in grey_box_tables[model]}
    assert dict(published_parameters()[model].printed) == printed


@pytest.mark.parametrize("model", GREY_BOX)
def test_a_circuit_starts_where_the_thesis_did(grey_box_tables, model):
    circuit = {each.name: each for each in load_circuit(model).parameters}
    assert set(circuit) == {_name(row[0]) for row in grey_box_tables[model]}
    for name, free, span, initial, _ in grey_box_tables[model]:
        each = circuit[_name(name)]
        assert (each.initial, each.free) == (float(initial), free.lower() == "yes")
        if each.name.startswith("w") and "infty" not in span:
            assert (each.low, each.high) == (0, 1)


def test_tables_4_1_4_7_and_4_8_are_the_texts(thesis_file):
    text, published = thesis_file("thesis.txt"), published_parameters()
    row = re.search(r"^Parameters\t(.+)\t(.+)\t(.+)$", text, re.MULTILINE).groups()
    kirchhoff = dict(zip(("R_battery_ambient", "R_usb_ambient", "R_flash_ambient"), map(_number, row)))
    assert dict(published["model1_kirchhoff"].printed) == {**kirchhoff, "q_e": 1.0}
    for sensor in ("Battery", "USB", "Flash"):
        k, m = re.search(rf"^{sensor} linear\t(.+)\t(.+)$", text, re.MULTILINE).groups()
        assert dict(published[f"linear_{sensor.lower()}"].printed) == {"k": float(k), "m": float(m)}
    combined = re.search(r"^Parameters\t(.+)\t(.+)\t(.+)\t(.+)$", text, re.MULTILINE).groups()
    assert list(published["linear_combined"].printed.values()) == list(map(float, combined))


def test_only_w1_of_table_4_4_is_corrected():
    found = published_parameters()
    assert tuple(found) == MODELS
    for model, each in found.items():
        if model != "model2_ss":
            assert each.corrected == each.printed
            assert not each.errata
    table_4_4 = found["model2_ss"]
    assert table_4_4.printed["w1"] == 0.42
    assert dict(table_4_4.corrected) == {**table_4_4.printed, "w1": 0.042}
    assert dict(table_4_4.errata) == {"w1": 6}


def test_every_parameter_table_has_its_number():
    tables = {name: each.table for name, each in published_parameters().items()}
    assert tables == dict(zip(MODELS, ("4.1", "4.2", "4.3", "4.4", "4.5", "4.6", "4.7", "4.7", "4.7", "4.8")))


def test_a_table_that_is_not_its_circuits_is_refused_with_every_fault():
    text = """
format: thesis-parameters
version: 1
models:
  linear_usb: {table: "4.7", published: {k: 1, n: 2}, corrected: {m: {value: 1, erratum: 3}}}
"""
    with pytest.raises(Refused) as refused:
        parse_parameters(text, "mine.yaml")
    assert [str(each) for each in refused.value.faults] == [
        "models.linear_usb.published: lacks m; add what the circuit has",
        "models.linear_usb.published: n: not in the circuit; remove it",
        "models.linear_usb.corrected: m: not published; remove it",
    ]
