"""The measured sets as traces: imported once a session by the command, from where they lie beside the repository."""

import json
import sys
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import pytest

from ambient_trainer.cli.main import main


class _Source(NamedTuple):
    """``map`` is None where the file is a trace."""

    file: str
    map: str | None
    format: str = "csv"


SOURCES = {
    "O5": _Source("twinhouse/validationdataO5Exp1.txt", "twinhouse"),
    "N2": _Source("twinhouse/validationdataN2Exp1.txt", "twinhouse"),
    "naked": _Source("rpi3-case-fan/pistress_0000000011.csv", "rpi3-case-fan"),
    "closed": _Source("rpi3-case-fan/pistress_1111100011.csv", "rpi3-case-fan"),
    "closed_but_for_a_side": _Source("rpi3-case-fan/pistress_1110100011.csv", "rpi3-case-fan"),
    "holed": _Source("rpi3-case-fan/pistress_1101010011.csv", "rpi3-case-fan"),
    "fan_in": _Source("rpi3-case-fan/pistress_1111001011.csv", "rpi3-case-fan"),
    "fan_out": _Source("rpi3-case-fan/pistress_1111000111.csv", "rpi3-case-fan"),
    "cell_2C": _Source("lg-m50-cell/Cell796_2C_25degC.csv", "lg-m50-cell-2C"),
    "cell_0": _Source("lg-m50-cell/Cell787_0p5C_0degC.csv", "lg-m50-cell-0degC"),
    "cell_10": _Source("lg-m50-cell/Cell787_0p5C_10degC.csv", "lg-m50-cell-10degC"),
    "cell_25": _Source("lg-m50-cell/Cell787_0p5C_25degC.csv", "lg-m50-cell-25degC"),
    "chamber": _Source("thermal-shock-chamber/dat00002.csv", "thermal-shock-chamber", "benchlink"),
    "s25": _Source("s25plus-zones/s25_zones_tidy.csv", "s25plus-zones"),
    "pv": _Source("pv-togo/togo_clean.csv", "pv-togo"),
    "li18650": _Source("li18650-r1/R1.csv", "li18650-r1"),
    "boiler": _Source("house-boiler/house.csv", None),
    "sandbox": _Source("trt-sandbox/sandbox.csv", None),
    "ice": _Source("ice-tank/charging.csv", None),
    "30q": _Source("samsung30q-hppc/hppc_10pct.csv", None),
}
"""By the name that a test asks for: the file, its map, and how it is read."""


@pytest.fixture(scope="session")
def measured(measured_folder, described, tmp_path_factory) -> Callable[[str], str]:
    """The path of the trace of a measured set; ``SOURCES`` has the names."""
    folder = tmp_path_factory.mktemp("measured")

    def imported(name: str) -> str:
        source = SOURCES[name]
        if source.map is None:
            return str(measured_folder / source.file)
        trace = folder / f"{name}.csv"
        if not trace.exists():
            _run(
                "import",
                measured_folder / source.file,
                "--format",
                source.format,
                "--map",
                described / f"{source.map}.map.yaml",
                "-o",
                trace,
            )
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
