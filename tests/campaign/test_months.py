"""Everything at once, for long: what a device does to the daemon in months, by the throw of a die."""

import random
import shutil
import signal
import socket

import pytest

from processes import resident_kB

from .conftest import KINDS

ERRORS = ("EAGAIN", "ENODATA", "ENXIO", "EIO", "ETIMEDOUT", "ENODEV")
PATIENCE_S = 0.25
"""The daemon's own."""
GARBAGE = (b"", b"-32768000\n", b"nan\n", b"125000\n", b"\xff" * 50)


class Months:
    """A running daemon, and what happens around it."""

    def __init__(self, daemon, zones, seed):
        self.daemon = daemon
        self.zones = zones
        self.dice = random.Random(seed)
        self.readers = []
        self.numbers = iter(range(100, 100_000))

    def kind(self):
        return self.dice.choice(KINDS)

    def heal(self, kind):
        if (self.zones.find(kind) / "temp.fault").exists():
            self.zones.heal(kind)
        self.zones.say(kind, self.dice.randrange(20000, 40000))

    def renumber(self, kind):
        self.zones.unplug(kind)
        self.zones.add(next(self.numbers), kind, 30000)

    def connect(self):
        self.readers.append(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        self.readers[-1].connect(str(self.daemon.outputs.socket))

    def leave(self):
        if self.readers:
            self.readers.pop(self.dice.randrange(len(self.readers))).close()

    def suspend(self):
        with self.daemon.suspended(float(2 ** self.dice.randrange(13))):
            self.heal(self.kind())

    def lose_folder(self):
        folder = self.daemon.outputs.folder
        shutil.rmtree(folder)
        for _ in range(self.dice.randrange(5)):
            self.daemon.tick()
        folder.mkdir()
        self.daemon.tick()

    def pass_by(self, events, steps):
        for _ in range(steps):
            if self.dice.random() < 0.1:
                self.dice.choice(events)(self)
            self.daemon.step()

    def rest(self):
        """All is well again, and quiet; what of the daemon is then to be seen."""
        for kind in KINDS:
            self.heal(kind)
        for reader in self.readers:
            reader.close()
        self.readers = []
        assert self.daemon.steps(150)[-1]["status"] == "tracking"
        return self.daemon.descriptors, self.daemon.threads


QUICK = [
    *(Months.connect, Months.leave, Months.suspend, Months.lose_folder),
    lambda it: it.heal(it.kind()),
    lambda it: it.renumber(it.kind()),
    lambda it: it.zones.fail(it.kind(), it.dice.choice(ERRORS)),
    lambda it: it.zones.say(it.kind(), it.dice.choice(GARBAGE)),
    lambda it: it.zones.say(it.kind(), it.dice.randrange(-10000, 60000)),
    lambda it: it.daemon.clock.set_wall_back_s(it.dice.uniform(-1e6, 1e6)),
]
RARE = [
    lambda it: it.daemon.process.send_signal(signal.SIGHUP),
    lambda it: it.zones.fail(it.kind(), block_s=0.3),
    lambda it: it.heal(it.kind()),
]


@pytest.mark.slow
def test_whatever_happens_it_says_the_same_everywhere_and_keeps_nothing(start, zones):
    """At each tick all that is published agrees; after each round it holds what it held before, and not more."""
    months = Months(start(supervision={"jump_K_per_s": 20, "stuck_after_s": 600}), zones, seed=4)
    held = months.rest()
    held_kB = []
    try:
        for _ in range(15):
            months.pass_by(QUICK, 600)
            months.pass_by(RARE, 30)
            assert months.rest() == held
            held_kB.append(resident_kB(months.daemon.process.pid))
    finally:
        for reader in months.readers:
            reader.close()
    assert held_kB[-1] - held_kB[len(held_kB) // 3] < 1024
    months.daemon.end()
