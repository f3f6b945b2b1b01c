"""A real MQTT broker, mosquitto, that can be stopped and started at the same address."""

import shutil
import subprocess
from pathlib import Path

import pytest

from processes import content_of, free_port, is_listening, wait_until

MOSQUITTO = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")


class Broker:
    """It forgets everything when it ends."""

    def __init__(self, folder: Path) -> None:
        pytest.importorskip("paho")
        if MOSQUITTO is None:
            pytest.skip("mosquitto is not installed")
        self.number = free_port()
        self.address = f"mqtt://127.0.0.1:{self.number}"
        self.file, self.log = folder / "mosquitto.conf", folder / "mosquitto.log"
        keys = (f"listener {self.number} 127.0.0.1", "allow_anonymous true", "persistence false", "user root")
        self.file.write_text("\n".join((*keys, f"log_dest file {self.log}", "log_type subscribe\n")))
        self.start()

    def start(self) -> None:
        """Start it, until it answers."""
        self.process = subprocess.Popen([str(MOSQUITTO), "-c", str(self.file)], stderr=subprocess.DEVNULL)
        wait_until(lambda: is_listening(self.number))

    def stop(self) -> None:
        """End it as a machine that fails."""
        self.process.kill()
        self.process.wait()

    def subscriptions(self, topic: str) -> int:
        """How often a topic was subscribed to."""
        return (content_of(self.log) or b"").decode().count(f" {topic}")

    def until_subscribed(self, topic: str, before: int) -> None:
        """What is published earlier, nobody hears."""
        wait_until(lambda: self.subscriptions(topic) != before)
