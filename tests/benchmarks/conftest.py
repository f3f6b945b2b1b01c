"""Benchmarks run when asked for, with ``pytest tests/benchmarks --benchmark-only``, and end in a table side by side."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

HERE = Path(__file__).parent
ROWS: pytest.StashKey[list[tuple[str, ...]]] = pytest.StashKey()
HEADER = ("task", "method", "wall s", "result")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[ROWS] = []


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("benchmark_only", False):
        return
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.skip(reason="a benchmark: run it with --benchmark-only"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    rows = config.stash.get(ROWS, [])
    if not rows:
        return
    widths = [max(len(row[k]) for row in [HEADER, *rows]) for k in range(len(HEADER))]
    terminalreporter.section("side by side, one BLAS thread")
    for row in [HEADER, *rows]:
        terminalreporter.write_line("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())


@pytest.fixture(autouse=True, scope="session")
def _one_thread():
    with threadpool_limits(1):
        yield


@pytest.fixture
def noted(request: pytest.FixtureRequest) -> Callable[[str, str, float, str], None]:
    """Puts a row into the table at the end: task, method, wall time in s, what came out."""

    def note(task: str, method: str, wall_s: float, result: str) -> None:
        request.config.stash[ROWS].append((task, method, f"{wall_s:.3g}", result))

    return note
