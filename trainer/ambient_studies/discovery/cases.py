"""The cases of the benchmark: simulated devices, most with something hidden in them; a seed and a number make a case.

Of 20 cases 3 hide nothing, 13 one effect and 4 two at once. Single effects go through every cause at every one of
``SCALES``; two are of the two larger ones, at different places, and of different causes. Every trace has decoys.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ambient_trainer.data import Trace
from ambient_trainer.simulator import (
    SIGNALS,
    Hidden,
    Simulated,
    draw_hidden,
    effect_kinds,
    load_device,
    load_scenario,
    simulate_many,
)

DEVICE, SCENARIO = "phone", "5"
"""Seven hours, with every load and air from cold to hot; any other device has a scenario of its own name."""
BASELINES = (SCENARIO, SCENARIO, "2.4")
PERIOD_S = 5.0
CAUSES = tuple(effect_kinds())
SCALES = (0.3, 0.7, 1.5, 3.0)
"""Of typical effects, which are about 2 degC in the sensor that feels most: half of them below the noise's fivefold."""
_PAIR_SCALES = SCALES[-2:]
_PATTERN = (1, 1, 2, 1, 0, 1, 1, 1, 2, 1, 0, 1, 1, 2, 1, 1, 0, 1, 2, 1)
"""How many effects a case hides, by its number."""
_DECOYS = (2, 4)
_LARGEST_SEED = 2**31


@dataclass(frozen=True)
class Case:
    """What is hidden in which run; ``decoys`` are logged beside the signals of the effects."""

    number: int
    seed: int
    """Of the run."""
    hidden: tuple[Hidden, ...]
    decoys: tuple[str, ...]
    scenario: str = SCENARIO
    device: str = DEVICE


def scenario_of(device: str) -> str:
    """The scenario in which effects are hidden in a device."""
    return SCENARIO if device == DEVICE else device


def draw_cases(seed: int, count: int, device: str = DEVICE) -> tuple[Case, ...]:
    """The first ``count`` cases of ``seed``; more of them leave those before as they are."""
    return tuple(_drawn(seed, number, device) for number in range(count))


def simulated(cases: Sequence[Case]) -> list[Simulated]:
    """The runs of cases, together in the time of one; each trace with its signals and its own decoys only."""
    asked, device = [(case.scenario, case.seed, case.hidden) for case in cases], load_device(cases[0].device)
    return [
        replace(run, trace=_logging(run.trace, case), clean=None if run.clean is None else _logging(run.clean, case))
        for case, run in zip(cases, simulate_many(asked, PERIOD_S, SIGNALS, sizes=True, device=device))
    ]


def baselines(seed: int, device: str = DEVICE, scenarios: Sequence[str] | None = None) -> list[Trace]:
    """Known-good runs of the same device, none of them with a case's seed."""
    random = np.random.default_rng([seed, _LARGEST_SEED])
    names = scenarios or (BASELINES if device == DEVICE else [scenario_of(device)] * len(BASELINES))
    runs = simulate_many([(name, _run_seed(random), ()) for name in names], PERIOD_S, device=load_device(device))
    return [run.trace for run in runs]


def _drawn(seed: int, number: int, device: str) -> Case:
    random = np.random.default_rng([seed, number])
    run_seed = _run_seed(random)
    effects = _effects(number, random, device)
    driving = {effect.signal for effect in effects}
    idle = [name for name in SIGNALS if name not in driving]
    decoys = random.choice(idle, int(random.integers(_DECOYS[0], _DECOYS[1] + 1)), replace=False)
    return Case(number, run_seed, effects, tuple(sorted(str(name) for name in decoys)), scenario_of(device), device)


def _effects(number: int, random: np.random.Generator, device: str) -> tuple[Hidden, ...]:
    wanted = _PATTERN[number % len(_PATTERN)]
    if wanted == 0:
        return ()
    duration_s = load_scenario(scenario_of(device)).duration_s
    hidden = partial(draw_hidden, random, duration_s=duration_s, device=load_device(device))
    if wanted == 2:
        while True:
            causes = random.choice(CAUSES, 2, replace=False)
            one, other = (hidden(str(cause), scale=float(random.choice(_PAIR_SCALES))) for cause in causes)
            if _apart(one, other):
                return one, other
    rounds, rest = divmod(number, len(_PATTERN))
    place = rounds * _PATTERN.count(1) + _PATTERN[:rest].count(1)
    return (hidden(CAUSES[place % len(CAUSES)], scale=SCALES[place // len(CAUSES) % len(SCALES)]),)


def _apart(one: Hidden, other: Hidden) -> bool:
    """Whether two effects share neither a place nor a signal; the battery's sensor sits at board2."""
    places = [
        {"battery" if place == "board2" else place for place in (effect.location or "all").split("-")}
        for effect in (one, other)
    ]
    return not places[0] & places[1] and (one.signal is None or one.signal != other.signal)


def _logging(trace: Trace, case: Case) -> Trace:
    kept = {*case.decoys, *(effect.signal for effect in case.hidden)}
    columns = {name: row for name, row in trace.columns.items() if name not in SIGNALS or name in kept}
    return replace(trace, columns=columns)


def _run_seed(random: np.random.Generator) -> int:
    return int(random.integers(_LARGEST_SEED))
