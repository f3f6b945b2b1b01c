"""The cases of the benchmark: simulated phones, most with something hidden in them; a seed and a number make a case.

Of 20 cases 3 hide nothing, 13 one effect and 4 two at once. Single effects go through every cause at every one of
``SCALES``; two are of the two larger ones, at different places, and of different causes. Every trace has decoys.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambient_trainer.data import Trace
from ambient_trainer.simulator import (
    SIGNALS,
    Hidden,
    Simulated,
    draw_hidden,
    effect_kinds,
    load_scenario,
    simulate_many,
)

SCENARIO = "5"
"""Seven hours, with every load and air from cold to hot."""
BASELINES = ("5", "5", "2.4")
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


def draw_cases(seed: int, count: int) -> tuple[Case, ...]:
    """The first ``count`` cases of ``seed``; more of them leave those before as they are."""
    return tuple(_drawn(seed, number) for number in range(count))


def simulated(cases: Sequence[Case]) -> list[Simulated]:
    """The runs of cases, together in the time of one; each trace with its signals and its own decoys only."""
    runs = [(case.scenario, case.seed, case.hidden) for case in cases]
    return [
        replace(run, trace=_logging(run.trace, case), clean=None if run.clean is None else _logging(run.clean, case))
        for case, run in zip(cases, simulate_many(runs, PERIOD_S, SIGNALS, sizes=True))
    ]


def baselines(seed: int, scenarios: Sequence[str] = BASELINES) -> list[Trace]:
    """Known-good runs of the same phone, none of them with a case's seed."""
    random = np.random.default_rng([seed, _LARGEST_SEED])
    return [run.trace for run in simulate_many([(name, _run_seed(random), ()) for name in scenarios], PERIOD_S)]


def _drawn(seed: int, number: int) -> Case:
    random = np.random.default_rng([seed, number])
    run_seed = _run_seed(random)
    effects = _effects(number, random)
    driving = {effect.signal for effect in effects}
    idle = [name for name in SIGNALS if name not in driving]
    decoys = random.choice(idle, int(random.integers(_DECOYS[0], _DECOYS[1] + 1)), replace=False)
    return Case(number, run_seed, effects, tuple(sorted(str(name) for name in decoys)))


def _effects(number: int, random: np.random.Generator) -> tuple[Hidden, ...]:
    wanted = _PATTERN[number % len(_PATTERN)]
    if wanted == 0:
        return ()
    duration_s = load_scenario(SCENARIO).duration_s
    if wanted == 2:
        return next(pair for pair in _pairs(random, duration_s) if _apart(*pair))
    rounds, rest = divmod(number, len(_PATTERN))
    place = rounds * _PATTERN.count(1) + _PATTERN[:rest].count(1)
    scale = SCALES[place // len(CAUSES) % len(SCALES)]
    return (draw_hidden(random, CAUSES[place % len(CAUSES)], duration_s, scale),)


def _pairs(random: np.random.Generator, duration_s: float) -> Iterator[tuple[Hidden, Hidden]]:
    while True:
        one, other = random.choice(CAUSES, 2, replace=False)
        yield (
            draw_hidden(random, str(one), duration_s, float(random.choice(_PAIR_SCALES))),
            draw_hidden(random, str(other), duration_s, float(random.choice(_PAIR_SCALES))),
        )


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
