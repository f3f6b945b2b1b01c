"""The measured sets as traces: imported once a session by the command, from where they lie beside the repository."""

import json
import sys
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest

from ambient_trainer.cli.main import main

SOURCES = {
    "O5": ("twinhouse/validationdataO5Exp1.txt", "twinhouse"),
    "N2": ("twinhouse/validationdataN2Exp1.txt", "twinhouse"),
    "naked": ("rpi3-case-fan/pistress_0000000011.csv", "rpi3-case-fan"),
    "closed": ("rpi3-case-fan/pistress_1111100011.csv", "rpi3-case-fan"),
    "closed_but_for_a_side": ("rpi3-case-fan/pistress_1110100011.csv", "rpi3-case-fan"),
    "holed": ("rpi3-case-fan/pistress_1101010011.csv", "rpi3-case-fan"),
    "fan_in": ("rpi3-case-fan/pistress_1111001011.csv", "rpi3-case-fan"),
    "fan_out": ("rpi3-case-fan/pistress_1111000111.csv", "rpi3-case-fan"),
    "cell_2C": ("lg-m50-cell/Cell796_2C_25degC.csv", "lg-m50-cell-2C"),
    "cell_0": ("lg-m50-cell/Cell787_0p5C_0degC.csv", "lg-m50-cell-0degC"),
    "cell_10": ("lg-m50-cell/Cell787_0p5C_10degC.csv", "lg-m50-cell-10degC"),
    "cell_25": ("lg-m50-cell/Cell787_0p5C_25degC.csv", "lg-m50-cell-25degC"),
    "s25": ("s25plus-zones/s25_zones_tidy.csv", "s25plus-zones"),
    "li18650": ("li18650-r1/R1.csv", "li18650-r1"),
    "boiler": ("house-boiler/house.csv", None),
    "30q": ("samsung30q-hppc/hppc_10pct.csv", None),
}
"""By the name that a test asks for: the file, and its map, or None where it is a trace."""


@pytest.fixture(scope="session")
def measured(beside, described, tmp_path_factory) -> Callable[[str], str]:
    """The path of the trace of a measured set; ``SOURCES`` has the names."""
    folder = tmp_path_factory.mktemp("measured")

    def imported(name: str) -> str:
        file, mapped = SOURCES[name]
        if mapped is None:
            return str(beside("measured") / file)
        trace = folder / f"{name}.csv"
        if not trace.exists():
            layout = described / f"{mapped}.map.yaml"
            _run("import", beside("measured") / file, "--format", "csv", "--map", layout, "-o", trace)
        return str(trace)

    return imported


@pytest.fixture(scope="session")
def circuit(described) -> Callable[[str], str]:
    """The path of the circuit of a measured set, such as ``twinhouse``."""
    return lambda name: str(described / f"{name}.circuit.yaml")


@pytest.fixture(scope="session")
def diagnose(measured, circuit, tmp_path_factory) -> Callable[..., dict[str, Any]]:
    """The JSON of ``ambient-trainer diagnose``, once a session: a circuit, traces, known-good traces, other options."""
    folder = tmp_path_factory.mktemp("diagnosed")

    @cache
    def of(name: str, traces: tuple[str, ...], known_good: tuple[str, ...] = (), *options: str) -> dict[str, Any]:
        path = folder / f"{'-'.join(traces)}.json"
        beside = [word for each in known_good for word in ("--baseline", measured(each))]
        _run("diagnose", *map(measured, traces), "--circuit", circuit(name), *beside, *options, "--json", path)
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return found

    return of


def _run(*arguments: object) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["ambient-trainer", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main()
    assert stopped.value.code == 0
