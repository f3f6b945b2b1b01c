"""Commands that run to their end, and what others take of the machine."""

import subprocess
from pathlib import Path
from typing import Any

Done = subprocess.CompletedProcess[str]


def ran(*words: object, status: int | None = 0, timeout: float | None = 60, **options: Any) -> Done:
    """What a command did; the test fails where its status is another than ``status``, None for any."""
    options = {"capture_output": True, "text": True, **options}
    done = subprocess.run([*map(str, words)], timeout=timeout, **options)
    assert status in (None, done.returncode), (done.stdout or "")[-2000:] + (done.stderr or "")[-2000:]
    return done


def resident_kB(pid: int) -> int:
    """The memory that a process holds."""
    return int(Path(f"/proc/{pid}/status").read_text().partition("VmRSS:")[2].split()[0])
