"""Benchmarks run when asked for, with ``pytest tests/benchmarks --benchmark-only``, and end in a table side by side."""

from collections.abc import Callable
from pathlib import Path

import pytest

from ambient_model.model import Estimator, Matrix, Model
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.readings import reading_model
from ambient_trainer.estimators.registry import CircuitEstimator
from ambient_trainer.simulator.simulate import simulate

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


@pytest.fixture
def noted(request: pytest.FixtureRequest) -> Callable[[str, str, float, str], None]:
    """Puts a row into the table at the end: task, method, wall time in s, what came out."""
    rows = request.config.stash[ROWS]
    return lambda task, method, wall_s, result: rows.append((task, method, f"{wall_s:.3g}", result))


def _without(estimator: Estimator, index: int) -> Estimator:
    """The same without one input: what a fallback costs does not depend on how good it is."""

    def cut(matrix: Matrix) -> Matrix:
        return tuple(row[:index] + row[index + 1 :] for row in matrix)

    return estimator._replace(
        inputs=estimator.inputs[:index] + estimator.inputs[index + 1 :],
        initial=cut(estimator.initial),
        discrete=tuple(each._replace(B=cut(each.B), D=cut(each.D)) for each in estimator.discrete),
    )


@pytest.fixture(scope="session")
def model() -> Model:
    """4 inputs, 3 states, what the readings are expected to be, and a fallback without each input."""
    trace = simulate("5", seed=1, period_s=5.0).trace
    fit = CircuitEstimator(load_circuit("model2_ss_free_cd")).fit([trace], Effort(starts=1))
    found = model_of(fit, [], {}, reading_model(fit, [trace]))
    others = {each.name: _without(found.main, index) for index, each in enumerate(found.main.inputs)}
    return found._replace(fallbacks=others)
