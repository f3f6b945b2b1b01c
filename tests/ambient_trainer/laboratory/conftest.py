"""A phone of files behind an ``adb`` that is a real process, and campaigns to run."""

import contextlib
import os
import shutil
import signal
from pathlib import Path

import pytest
import yaml

from ambient_trainer.data.trace import load_trace
from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.collect import Job, collect
from ambient_trainer.laboratory.instruments import ChamberLimits, instrument
from ambient_trainer.laboratory.messages import Clock
from ambient_trainer.laboratory.run import Supervision
from ambient_trainer.laboratory.simulation import simulated_laboratory
from ambient_trainer.simulator.scenario import scenario_path
from device import add_zone

SHELLS = [path for name in ("dash", "bash", "mksh", "busybox") if (path := shutil.which(name))]

ADB = """#!/bin/sh
[ -e "{here}/cable" ] || {{ echo "error: no devices/emulators found" >&2; exit 1; }}
echo "* daemon not running; starting now at tcp:5037"
echo $$ >>"{here}/pids"
exec {shell}
"""


class FilePhone:
    """Files as a kernel shows them, and an adb in front of a shell; the uptime is this machine's own."""

    def __init__(self, folder: Path, shell: str) -> None:
        self.folder = folder
        for name in ("bin", "proc", "sys/class/thermal", "sys/class/power_supply/battery"):
            (folder / name).mkdir(parents=True)
        (folder / "proc/uptime").symlink_to("/proc/uptime")
        adb = folder / "bin/adb"
        adb.write_text(ADB.format(here=folder, shell=f"{shell} sh" if shell.endswith("busybox") else shell))
        adb.chmod(0o755)
        self.plug()

    @property
    def root(self) -> str:
        return str(self.folder)

    @property
    def environment(self) -> dict[str, str]:
        return {"PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}"}

    def zone(self, number: int, kind: str, content: str | None) -> Path:
        return add_zone(self.folder / "sys", number, kind, content) / "temp"

    def supply(self, attribute: str, content: str) -> None:
        (self.folder / "sys/class/power_supply/battery" / attribute).write_text(content)

    def up(self, seconds: float) -> None:
        uptime = self.folder / "proc/uptime"
        uptime.unlink()
        uptime.write_text(f"{seconds:.2f} 1.00\n")

    def plug(self) -> None:
        (self.folder / "cable").touch()

    def pull(self) -> None:
        (self.folder / "cable").unlink()
        self.kill(signal.SIGKILL)

    def kill(self, number: int) -> None:
        for pid in (self.folder / "pids").read_text().split():
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), number)


@pytest.fixture
def closed():
    """Gives back what it is given, and closes it at the end, the last one first."""
    with contextlib.ExitStack() as stack:
        yield lambda made: stack.enter_context(contextlib.closing(made))


@pytest.fixture
def driver_of(closed):
    """Makes the driver of some settings; a chamber's goes from -20 to 60 degC."""

    def make(named, clock=None):
        limits = [ChamberLimits(low_degC=-20.0, high_degC=60.0)] * (named.kind == "voetsch-vt4004")
        return closed(instrument(named.kind).Driver(named, clock or Clock(), *limits))

    return make


@pytest.fixture(params=SHELLS, ids=os.path.basename)
def phone(request, tmp_path) -> FilePhone:
    """The same in every shell that is here: an Android phone has mksh, a board busybox or dash."""
    return FilePhone(tmp_path / "phone", request.param)


@pytest.fixture
def one_phone(tmp_path) -> FilePhone:
    return FilePhone(tmp_path / "phone", SHELLS[0])


@pytest.fixture
def laboratory_data() -> dict:
    """The shipped laboratory, as it stands in its file."""
    return yaml.safe_load((Path(scenario_path("1")).parent / "laboratory.yaml").read_text())


@pytest.fixture
def campaign_file(write, laboratory_data):
    """Write a campaign file: changes to the laboratory by dotted place, steps, and further keys."""

    def written(steps=None, changes=None, name="night.yaml", **further) -> str:
        for place, value in (changes or {}).items():
            *path, last = place.split(".")
            part = laboratory_data
            for key in path:
                part = part[key]
            part[last] = value
        data = {
            "format": "ambient-campaign",
            "version": 1,
            "about": "a test",
            "laboratory": laboratory_data,
            "steps": [{"duration_min": 1, "chamber_degC": 20}] if steps is None else steps,
            **further,
        }
        return write(name, yaml.safe_dump({key: value for key, value in data.items() if value is not None}))

    return written


in_real_time = pytest.mark.slow
"""A busy machine misses samples."""


def minutes(*steps):
    """Steps of a campaign: minutes, set point, actions, gradient."""
    return [dict(zip(("duration_min", "chamber_degC", "load", "gradient_K_min"), step)) for step in steps]


class Night:
    """A campaign in a simulated laboratory, in fast time."""

    def __init__(self, path, output, speed=150.0) -> None:
        self.loaded, self.speed = load_campaign(path, ports=False), speed
        self.output, self.part = str(output), Path(f"{output}.part")
        self.stop = self.held_degC = None

    def run(
        self, deeds=(), work=collect, giving_up=False, before=lambda there: None, monitor=None, event=None, own=None
    ):
        """What it said; deeds are done when their time has come, ``own`` instruments replace the simulated ones."""
        deeds, events, self.stop = list(deeds), [], None

        def update(run):
            while deeds and run.clock.now_s() >= deeds[0][0]:
                deeds.pop(0)[1](there)
            if monitor:
                monitor(run)

        with simulated_laboratory(self.loaded, Clock(self.speed), seed=3) as there:
            before(there)
            laboratory = there.loaded.campaign.laboratory
            instruments = laboratory.instruments.model_copy(update=own or {})
            laboratory = laboratory.model_copy(update={"instruments": instruments})
            loaded = there.loaded._replace(campaign=there.loaded.campaign.model_copy(update={"laboratory": laboratory}))
            self.job = Job(loaded, self.output, self.speed, True, there.environment)
            say = event or (lambda at_s, text: events.append(text))
            supervision = Supervision(update, say, lambda: self.stop, lambda: giving_up and bool(self.stop))
            try:
                self.outcome = work(self.job, supervision).outcome
            finally:
                self.held_degC = there.chamber and there.chamber.held_degC
                self.activity = (Path(there.phone.root) / "activity").read_text().strip()
        return events

    @property
    def trace(self):
        return load_trace(self.output)


@pytest.fixture
def night(campaign_file, tmp_path):
    """Makes the night of some steps; a machine that is loaded stalls for some of a fast clock's minutes."""

    def make(steps, changes=None, speed=150.0, **further) -> Night:
        patient = {"safety.ambient_lost_s": 1200, "safety.confirm_s": 1200}
        return Night(campaign_file(steps, {**patient, **(changes or {})}, **further), tmp_path / "trace.csv", speed)

    return make
