"""A small model made by hand, a fake sysfs of real files, and the daemon as a real process."""

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ambient_model.codec import decode, encode
from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, ErrorVariance, Estimator, Input, Model, Secondary, Term
from device import add_zone, write_files
from processes import Done, ran

PERIODS_S = (0.1, 0.2, 0.5, 1.0)
INTERVAL = {50: (-0.2, 0.3), 90: (-0.5, 0.75), 98: (-1.0, 1.5)}
USB = Input("usb", "degC", "usb-therm", -20.0, 90.0)
BATTERY = Input("battery", "degC", "battery", -20.0, 70.0)


def text(path: Path) -> str:
    """What a file holds; nothing where it is not there."""
    return path.read_text() if path.exists() else ""


def lag(period_s: float, tau_s: float) -> float:
    return math.exp(-period_s / tau_s)


def single(of: Input, tau_s: float, offset: float) -> Estimator:
    """One lag on one input, for a fallback."""
    return Estimator(
        inputs=(of,),
        states=(f"{of.name}_lagged",),
        discrete=tuple(
            Discrete(p, ((lag(p, tau_s),),), ((1 - lag(p, tau_s),),), ((1.0,),), ((0.0,),)) for p in PERIODS_S
        ),
        offset=offset,
        initial=((1.0,),),
        interval={50: (-1.0, 1.0), 90: (-2.0, 2.0), 98: (-3.0, 3.0)},
    )


SPREAD = ErrorVariance(
    0.25,
    (Term("movement", 60.0, 1.0), Term("movement", 20.0, 9.0), Term("guard", 30.0, 0.25)),
    {50: (-0.5, 0.75), 90: (-1.5, 2.0), 98: (-2.5, 3.0)},
)


def made_model(inputs: tuple[Input, ...] = (USB, BATTERY), fallbacks: bool = False, guarded: bool = False) -> Model:
    """Two first-order lags (40 s on usb, 10 s on battery): ambient = usb + 0.8 (battery lagged - usb lagged)."""
    lags = [(each, lag(each, 40.0), lag(each, 10.0)) for each in PERIODS_S]
    main = Estimator(
        inputs=inputs,
        states=("usb_lagged", "battery_lagged"),
        discrete=tuple(
            Discrete(each, ((a, 0.0), (0.0, b)), ((1 - a, 0.0), (0.0, 1 - b)), ((-0.8, 0.8),), ((1.0, 0.0),))
            for each, a, b in lags
        ),
        offset=-3.0,
        initial=((1.0, 0.0), (0.0, 1.0)),
        interval=INTERVAL,
    )
    others = {"usb": single(BATTERY, 20.0, -5.0), "battery": single(USB, 20.0, -1.0)} if fallbacks else {}
    steps = tuple((25.0 + k % 7, 30.0 - 0.5 * k) for k in range(20))
    model = Model("bench", "2024-05-01", "ambient_degC", main, others, {}, conformance_of(main, steps))
    if guarded:
        # the battery with a lag of 20 s, less 2 degC: where usb is at 30 and battery at 25, the main estimator agrees
        alone = single(BATTERY, 20.0, -2.0)
        discrete = tuple(each._replace(B=((0.0, each.B[0][0]),), D=((0.0, 0.0),)) for each in alone.discrete)
        alone = alone._replace(inputs=(USB, BATTERY), discrete=discrete, initial=((0.0, 1.0),))
        model = model._replace(secondary=Secondary(alone, 1.0), error_variance=SPREAD)
    return decode(encode(model).encode(), "made by hand")


@pytest.fixture(scope="session")
def make_model() -> Callable[..., Model]:
    return made_model


@pytest.fixture
def model_file(saved: Callable[[Model], str]) -> str:
    return saved(made_model())


class FakeSysfs:
    """Thermal zones as files."""

    def __init__(self, root: Path) -> None:
        self.root = root
        (root / "class" / "thermal").mkdir(parents=True)

    def zone(self, number: int, kind: str, temp: str) -> Path:
        return add_zone(self.root, number, kind, temp) / "temp"


@pytest.fixture
def sysfs(tmp_path: Path) -> FakeSysfs:
    return FakeSysfs(tmp_path / "sys")


@pytest.fixture
def make_hwmon(sysfs: FakeSysfs) -> Callable[..., Path]:
    """A hwmon chip as files: number, name, and temperatures (number, label or None, content)."""

    def make(number: int, chip: str, *temperatures: tuple[int, str | None, str]) -> Path:
        files = {"name": f"{chip}\n", **{f"temp{index}_input": content for index, _, content in temperatures}}
        files |= {f"temp{index}_label": f"{label}\n" for index, label, _ in temperatures if label is not None}
        return write_files(sysfs.root / "class" / "hwmon" / f"hwmon{number}", files)

    return make


@pytest.fixture
def make_supply(sysfs: FakeSysfs) -> Callable[..., Path]:
    """A power supply with its properties as files; returns the root of the fake sysfs."""

    def make(name: str, **properties: str) -> Path:
        write_files(sysfs.root / "class" / "power_supply" / name, properties)
        return sysfs.root

    return make


@pytest.fixture
def phone(sysfs: FakeSysfs) -> FakeSysfs:
    """A device with both sensors of the model at rest: ambient is 0.8 * 25 + 0.2 * 30 - 3 = 23."""
    sysfs.zone(0, "cpu-0-0", "41000\n")
    sysfs.zone(3, "battery", "25000\n")
    sysfs.zone(10, "usb-therm", "30000\n")
    return sysfs


@pytest.fixture
def on_phone(model_file: str, phone: FakeSysfs) -> Callable[..., list[str]]:
    """The arguments that run the model on the phone at 20 Hz and publish to some outputs."""
    run = ["run", "--model", model_file, "--sysfs-root", str(phone.root), "--rate", "20"]
    return lambda *outputs: [*run, *(word for each in outputs for word in ("--publish", each))]


@pytest.fixture
def path(tmp_path: Path) -> str:
    """Of a socket."""
    return str(tmp_path / "s")


@pytest.fixture
def configure(write: Callable[[str, str], str], model_file: str, phone: FakeSysfs) -> Callable[..., str]:
    """Write a configuration of the model on the phone at 20 Hz, with some keys as given."""
    on_phone = {"model": model_file, "rate_hz": 20, "sysfs_root": str(phone.root)}
    return lambda **keys: write("c.json", json.dumps({**on_phone, **keys}))


WHOLE: dict[str, Any] = {
    "model": "phone.json",
    "rate_hz": 10,
    "sysfs_root": "/fake",
    "level_percent": 98,
    "zones": {"usb": "usbc-therm-adc"},
    "zones_by_name": "links",
    "sensors": {
        "skin": {"zone": "quiet-therm"},
        "inlet": {"hwmon": "nct6775", "label": "SYSTIN"},
        "battery": {"power_supply": "battery", "property": "temp"},
        "battery_current": {"power_supply": "bms", "property": "current_now", "sign": -1},
        "battery_voltage": {"power_supply": "bms", "property": "voltage_now"},
    },
    "supervision": {"stuck_after_s": 3600, "stuck_within_K": 0.1, "jump_K_per_s": 0.5},
    "coast_s": 5,
    "state": {"path": "state", "max_age_s": 100},
    "access": {"mode": "0640", "owner": 0, "group": "0"},
    "publish": [
        "stdout",
        "file-in-place:/run/a",
        "socket:s",
        {"kind": "file", "path": "/run/b", "mode": "in-place", "poison_millidegC": -274000, "at_exit": "poison"},
        {"kind": "file", "path": "/run/c", "offset_millidegC": 7},
    ],
}
"""A configuration with every key."""


@pytest.fixture
def status(tmp_path: Path) -> Callable[[], dict]:
    """What ``status:`` in the folder of the test says; nothing where it is not there."""
    path = tmp_path / "status"
    return lambda: json.loads(path.read_text()) if path.exists() else {}


WriteTrace = Callable[..., str]


@pytest.fixture
def write_trace(write: Callable[[str, str], str]) -> WriteTrace:
    """Write rows (None for a missing value) under a header."""

    def written(rows: list[tuple[float | None, ...]], header: str = "time_s,usb_degC,battery_degC") -> str:
        cells = [",".join("" if value is None else repr(value) for value in row) for row in rows]
        return write("trace.csv", "\n".join([header, *cells]) + "\n")

    return written


@pytest.fixture
def trace_file(write_trace: WriteTrace) -> str:
    """Ten minutes at 1 Hz, warming."""
    rows = [(100.0 + k, 30 + 5 * (1 - math.exp(-k / 80)), 25 + 3 * math.sin(k / 50)) for k in range(600)]
    return write_trace(rows)


AMBIENTD = ("-m", "ambientd")


@pytest.fixture
def ambientd() -> Callable[..., Done]:
    """Run the command to its end, or what Python takes ``by``; the test fails where its status is another."""
    return lambda *arguments, by=AMBIENTD, status=0: ran(sys.executable, *by, *arguments, status=status)


Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(spawn: Start) -> Start:
    """Start the command and leave it running."""
    return lambda *arguments, by=AMBIENTD, **options: spawn(
        [sys.executable, *by, *arguments], **{"stderr": subprocess.PIPE, **options}
    )


@pytest.fixture
def ended() -> "Callable[..., tuple[int, str, str]]":
    """Status, stdout and stderr of a process after a signal."""

    def end(process: "subprocess.Popen[str]", by: int = signal.SIGTERM) -> tuple[int, str, str]:
        os.kill(process.pid, by)
        out, err = process.communicate(timeout=15)
        return process.returncode, out, err

    return end
