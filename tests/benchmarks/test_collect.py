"""What one slow instrument costs the others: how late their samples are asked for, in real time.

The laboratory is simulated, on pseudo-terminals and a real shell; its clock is the machine's.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.collect import Job, collect
from ambient_trainer.laboratory.messages import DEVICE, MULTIPLEXER, Clock, Sample
from ambient_trainer.laboratory.run import CampaignRun, Supervision
from ambient_trainer.laboratory.simulation import simulated_laboratory
from ambient_trainer.simulator.scenario import scenario_path
from breaking import distort

RUN_MIN = 0.75
PERIOD_S = 0.5
SLOW_S = 3.0
MOST_S = 0.05
"""What issue and README promise."""


def _campaign(write: Callable[[str, str], str]) -> str:
    laboratory = yaml.safe_load((Path(scenario_path("1")).parent / "laboratory.yaml").read_text())
    instruments = laboratory["instruments"]
    instruments["chamber"].update(period_s=PERIOD_S, timeout_s=10.0)
    instruments["multiplexer"].update(period_s=PERIOD_S, timeout_s=10.0)
    laboratory["device"]["period_s"] = PERIOD_S
    steps = [{"duration_min": RUN_MIN, "chamber_degC": 25}]
    head = {"format": "ambient-campaign", "version": 1, "about": "a benchmark"}
    return write("benchmark.yaml", yaml.safe_dump({**head, "laboratory": laboratory, "steps": steps}))


@pytest.mark.parametrize(
    ("slow", "others"),
    [("none", (DEVICE, MULTIPLEXER)), ("chamber", (DEVICE, MULTIPLEXER)), ("multiplexer", (DEVICE,))],
)
def test_lateness(benchmark, write, tmp_path, noted, slow, others) -> None:
    loaded = load_campaign(_campaign(write), ports=False)

    def run() -> list[Sample]:
        with simulated_laboratory(loaded, Clock()) as there:
            job = Job(there.loaded, str(tmp_path / "trace.csv"), 1.0, True, there.environment)
            late = [getattr(there, slow)] * 200 if slow != "none" else []

            def slow_down(run: CampaignRun) -> None:
                """From the first look on, which is the beginning."""
                while late:
                    distort(late.pop(), bytes, SLOW_S)

            collected = collect(job, Supervision(slow_down, lambda *_: None, lambda: None, lambda: False))
        return [entry for entry in collected.record.entries if isinstance(entry, Sample)]

    samples = benchmark.pedantic(run, rounds=1, iterations=1)
    slowest_s = max((each.answered_s - each.asked_s for each in samples if each.source == slow), default=0.0)
    late_s = np.array([each.asked_s % PERIOD_S for each in samples if each.source in others])
    asked = sorted({round(each.asked_s / PERIOD_S) for each in samples if each.source == DEVICE})
    left_out = asked[-1] - asked[0] + 1 - len(asked)
    late = f"{1e3 * np.median(late_s):.2f} ms (median), {1e3 * late_s.max():.2f} ms (worst)"
    result = f"{len(late_s)} samples of {' and '.join(others)} late by {late}; {left_out} of the device's left out"
    noted(f"lateness, slow: {slow} ({slowest_s:.1f} s)", f"every {PERIOD_S:g} s", 60.0 * RUN_MIN, result)
    assert slow == "none" or late_s.max() < MOST_S  # without a slow one it is the machine's own
    assert left_out == 0
