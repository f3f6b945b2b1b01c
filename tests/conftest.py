"""Property tests that draw the same examples every time; the command line and model files."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from ambient_model.model import Model

settings.register_profile("same", derandomize=True, deadline=None, database=None)
settings.load_profile("same")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # tests that run in a shell's background ignore Ctrl-C, and so would every program that they start
    signal.signal(signal.SIGINT, signal.default_int_handler)

SLOW_LIMIT_S = 900.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A slow test may take longer than pyproject.toml gives to each."""
    for item in items:
        if item.get_closest_marker("slow") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(SLOW_LIMIT_S))


@pytest.fixture
def trainer(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[Any, str, str]]:
    """Runs ``ambient-trainer`` with arguments and returns its status, its output and its messages."""

    from ambient_trainer.cli.main import main  # the device's tests should not wait for it

    def run(*arguments: object) -> tuple[Any, str, str]:
        monkeypatch.setattr(sys, "argv", ["ambient-trainer", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main()
        return (stopped.value.code, *capsys.readouterr())

    return run


@pytest.fixture
def saved(tmp_path: Path) -> Callable[[Model], str]:
    """Writes a model and returns its path."""

    from ambient_model.codec import save_model

    def save(model: Model) -> str:
        path = str(tmp_path / "model.json")
        save_model(path, model)
        return path

    return save
