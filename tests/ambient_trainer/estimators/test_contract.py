"""Every estimator keeps one contract, and a new one is one file."""

import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from ambient_trainer.data.plugins import plugin_names
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.check import check_estimator
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.registry import LIBRARY, estimator, estimator_names

ANY = [name for name in estimator_names() if estimator(name).reads_any and estimator(name).name == name]


def made(seed: int, samples: int, names: tuple[str, ...] = ("battery", "usb")) -> Trace:
    """Sensors behind an ambient that changes, each with a lag and noise of its own, every 5 s."""
    random = np.random.default_rng(seed)
    time_s = np.arange(samples) * 5.0
    ambient = 20 + 5 * np.sin(time_s / 900) + np.cumsum(random.normal(0, 0.05, samples))
    columns = {"ambient_degC": ambient}
    for index, name in enumerate(names):
        lag, heat = 30.0 * (1 + index), np.repeat(random.uniform(0, 5, samples // 50 + 1), 50)[:samples]
        row = np.empty(samples)
        row[0] = ambient[0]
        for k in range(1, samples):
            row[k] = row[k - 1] + 5.0 / (lag + 5.0) * (ambient[k] + heat[k] / (1 + index) - row[k - 1])
        columns[f"{name}_degC"] = row + random.normal(0, 0.02, samples)
    return Trace(f"made {seed}", time_s, columns)


@pytest.mark.parametrize(
    "name", ["linear_usb", *(pytest.param(each, marks=[pytest.mark.slow] * (each == "free_observer")) for each in ANY)]
)
def test_the_contract_holds(name: str) -> None:
    check_estimator(estimator(name), [made(1, 160)], made(2, 80))


def test_it_holds_for_a_circuit_with_states() -> None:
    names = ("soc", "flash", "battery", "usb")
    check_estimator(estimator("model1_kirchhoff"), [made(1, 240, names)], made(2, 120, names))


class Peeking(FreeFilterEstimator):
    """Its estimate looks ahead."""

    def fit(self, *given, **named):
        fit = super().fit(*given, **named)
        object.__setattr__(fit, "estimate_degC", lambda trace: np.roll(trace.columns["usb_degC"], -1))
        return fit


def test_a_breach_is_named() -> None:
    with pytest.raises(AssertionError, match="causal"):
        check_estimator(Peeking(1), [made(1, 160)], made(2, 80))


PLUG_IN = """
from ambient_trainer.estimators.library.free import FreeFilterEstimator

NAMES = ("mine",)


def find(name):
    return FreeFilterEstimator(1) if name == "mine" else None
"""


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder beside the shipped library, of the same package."""
    package = sys.modules[LIBRARY]
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    plugin_names.cache_clear()
    yield tmp_path
    plugin_names.cache_clear()


def test_a_new_estimator_is_one_file(library: Path) -> None:
    (library / "mine.py").write_text(PLUG_IN)
    assert "mine" in estimator_names()
    assert estimator("mine").fit([made(1, 200)], Effort(starts=1)).states == ("mode1",)


def test_a_new_recipe_is_one_file(tmp_path: Path) -> None:
    shipped = resources.files(LIBRARY) / "phone_observer.yaml"
    path = tmp_path / "mine.yaml"
    path.write_text(shipped.read_text().replace("name: phone_observer", "name: mine"))
    assert estimator(str(path)).name == "mine"
