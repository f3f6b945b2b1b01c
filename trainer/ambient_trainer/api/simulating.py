"""``at.simulate``: what a simulated device logs, and what is hidden in it."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from ambient_trainer.api.result import Result
from ambient_trainer.data.trace import save_trace
from ambient_trainer.report import Facts, Report, Section, Table
from ambient_trainer.simulator import Simulated
from ambient_trainer.simulator import simulate as simulated_run
from ambient_trainer.simulator.text import hidden_text


@dataclass(frozen=True, repr=False)
class SimulationResult(Result):
    """A simulated run.

    Attributes
    ----------
    simulated : Simulated
        The trace, the hidden effects and the truth about each.
    scenario : str
        What was played.
    """

    simulated: Simulated
    scenario: str

    @cached_property
    def trace(self) -> pd.DataFrame:
        """What the device logs, indexed by ``time_s``; nothing in it says what is hidden."""
        return self.simulated.trace.to_frame()

    @cached_property
    def truth(self) -> pd.DataFrame:
        """One row a hidden effect, in the terms of a diagnosis."""
        return pd.json_normalize(self._truths())

    @property
    def summary(self) -> Report:
        """What was simulated and what is hidden in it."""
        trace = self.simulated.trace
        rows = [(each["hidden"], str(each.get("cause", "")), str(each.get("location", ""))) for each in self._truths()]
        return Report(
            subject="Simulation",
            title=f"Scenario {self.scenario}: {len(trace.time_s):,} simulated samples",
            lead=[Facts([("columns", ", ".join(trace.columns))])],
            sections=[Section("Hidden effects", [Table("", ("effect", "cause", "location"), rows, labels=3)])]
            if rows
            else [],
            data={"effects": self._truths()},
        )

    def _write(self, path: str) -> None:
        save_trace(path, self.simulated.trace)

    def _truths(self) -> list[dict[str, Any]]:
        pairs = zip(self.simulated.hidden, self.simulated.truths)
        return [{"hidden": hidden_text(each), **asdict(truth)} for each, truth in pairs]


def simulate(
    scenario: str,
    device: str = "phone",
    *,
    seed: int = 0,
    period_s: float = 1.0,
    hide: Sequence[str] = (),
    decoys: Sequence[str] = (),
    all_zones: bool = False,
    sizes: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> SimulationResult:
    """Simulate what a device logs in a scenario, with or without effects hidden in it.

    Parameters
    ----------
    scenario : str
        A shipped scenario (``1``, ``2.1`` to ``2.5``, ``3``, ``4``, ``5`` of the thesis) or a YAML file.
    device : str
        A shipped device or a YAML file.
    seed : int
        Of weather, noise, and what ``hide`` leaves open.
    period_s : float
        Time between samples.
    hide : sequence of str
        Effects as ``CAUSE[:PLACE][:SIZE][:KEY=VALUE]...``, such as ``heat_source:board2:0.8W:from=2h:to=3h``, or
        ``random``.
    decoys : sequence of str
        Signals to log that change no temperature.
    all_zones : bool
        Whether to log every zone of the device and not only its sensors.
    sizes : bool
        Whether to simulate each effect alone, too, for its size in degC in ``truth``.
    progress : callable, optional
        Called with the samples that are done and all of them.

    Returns
    -------
    SimulationResult
        The trace and the truth.

    Raises
    ------
    Refused
        For an unknown scenario or device, and effects with faults.

    Notes
    -----
    At every node :math:`C \\dot T = P + \\sum G (T_j - T) - h A (T - T_a)^{1.25} - \\epsilon \\sigma A (T^4 - T_a^4)`:
    natural convection and radiation (Incropera and DeWitt, chapters 1 and 9), integrated by RK4.

    Examples
    --------
    >>> import ambient_trainer as at
    >>> run = at.simulate("2.1", seed=1, period_s=60.0, hide=["sensor_bias:usb:2K"])
    >>> run.trace.columns[0]
    'soc_degC'
    >>> run.truth["cause"].tolist()
    ['sensor_bias']
    """
    run = simulated_run(
        scenario, device, seed, period_s, hide, decoys=decoys, all_zones=all_zones, sizes=sizes, progress=progress
    )
    return SimulationResult(run, scenario)
