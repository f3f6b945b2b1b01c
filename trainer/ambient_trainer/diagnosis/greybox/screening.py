"""Screening of candidate mechanisms by a score test of what each would leave on held-out data.

The score test takes each candidate's first-order effect on the *simulated* sensors, projects out what the model's own
numbers could do as well, and solves for its amount (Rao 1948). Measured temperatures are never regressors.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.regression import EACH_FOLD, LEFT_OUT, Fitted, FoldData
from ambient_trainer.diagnosis.greybox.windows import Columns, best_windows
from ambient_trainer.diagnosis.record import Record

_MECHANISMS = f"{__package__}.mechanisms"
_SHORTLIST, _DRIVERS, _STARTS = 6, 10, 4
_RUN_AWAY = 1e100
"""What is larger has no square."""
Offered = Callable[[Context, Columns], Iterator[Mechanism]]


@dataclass(frozen=True)
class Screened:
    """A candidate by the score test: as it would start, and the sum of squares that is held out."""

    mechanism: Mechanism
    held_out: float
    point: Fitted
    """The model beside which it was screened."""


def permanent_candidates(context: Context, columns_of: Columns) -> Iterator[Mechanism]:
    """Candidates of every kind of mechanism that act throughout the record."""
    yield from _offered(context, "candidates")


def every_candidate(context: Context, columns_of: Columns) -> Iterator[Mechanism]:
    """Permanent candidates, and temporary ones, each in its best window."""
    yield from permanent_candidates(context, columns_of)
    yield from _windowed(context, columns_of, _offered(context, "windowed"))
    yield from _windowed(context, columns_of, _offered(context, "alone"))


def ambient_distinct_candidates(context: Context, columns_of: Columns) -> Iterator[Mechanism]:
    """Those of :func:`permanent_candidates` that no other ambient replaces: neither constant heat nor a slow body."""
    for each in permanent_candidates(context, columns_of):
        if not each.adds_nodes and (each.cause != "heat_source" or each.driver is not None):
            yield each


def change_candidates(context: Context, columns_of: Columns) -> Iterator[Mechanism]:
    """Candidates of a change since known-good records: permanent ones, and those that may have begun or ended."""
    windowed = _windowed(context, columns_of, _offered(context, "windowed"))
    yield from (each for each in (*permanent_candidates(context, columns_of), *windowed) if not each.structural)
    yield from _offered(context, "windowed")
    yield from _offered(context, "changed")
    yield from _windowed(context, columns_of, _offered(context, "begun"))


def _offered(context: Context, how: str) -> Iterator[Mechanism]:
    """What the kinds of mechanism offer by a function of that name."""
    for name in plugin_names(_MECHANISMS):
        yield from getattr(plugin(_MECHANISMS, name), how, lambda context: ())(context)


def _windowed(context: Context, columns_of: Columns, offered: Iterable[Mechanism]) -> Iterator[Mechanism]:
    """Each candidate in its best windows, and other mechanisms in the same windows."""
    for each in offered:
        for placed in best_windows(context.fitted, each, columns_of):
            yield placed
            for name in plugin_names(_MECHANISMS):
                beside = getattr(plugin(_MECHANISMS, name), "beside", None)
                yield from () if beside is None else beside(context, placed)


def screen(context: Context, offered: Offered) -> list[Screened]:
    """Candidates of ``offered`` by what they would leave on held-out blocks, to first order; best first."""
    fitted = context.fitted
    columns_of = effect_columns(fitted)
    parts = {True: fitted.by_fold, False: fitted.by_stretches}
    result = []
    for each in offered(context, columns_of):
        columns = columns_of(each)
        # where one of several places shows nothing, the others are offered without it
        if not columns.any(axis=0).all():
            continue
        amounts, squares = _score_test(fitted, parts[each.permanent], columns, each.permanent)
        started = each.started([float(amount) for amount in amounts])
        if started is not None and np.isfinite(squares):
            result.append(Screened(started, squares, fitted))
    return sorted(result, key=lambda each: each.held_out)


def effect_columns(fitted: Fitted) -> Columns:
    """First-order effect of each probe of a mechanism on the sensors, (M, k)."""
    beside = [_LinearisedModel(fitted.model, record, run.start) for record, run in zip(fitted.records, fitted.runs)]
    return lambda mechanism: np.concatenate([each.effect(mechanism) for each in beside])


class _LinearisedModel:
    """A model linearised along its simulation of a record."""

    def __init__(self, model: GreyBox, record: Record, start: Array) -> None:
        self.model, self.record, self.start = model, record, start
        network = model.network(record, model.z()[None])
        self.nodes = network.nodes_degC(start[None])[0]
        self.read = network.read(self.nodes[None])[0]
        self._linearised: dict[int, Network] = {}

    def effect(self, mechanism: Mechanism) -> Array:
        """What each probe of a mechanism adds to the sensors, (M, k); nothing where one makes them run away."""
        probes = np.array(mechanism.probes(), dtype=float)
        network = self._network(len(probes))
        mechanism.apply(network, probes, self.record.simulated)
        first = np.full((len(probes), len(network.nodes)), self.start[network.reads].mean())
        first[:, : len(self.start)] = self.start
        with np.errstate(all="ignore"):
            added = self.record.weighted(network.simulate(first) - self.read).T
        return np.asarray(added if (np.abs(added) < _RUN_AWAY).all() else np.zeros_like(added))

    def _network(self, lanes: int) -> Network:
        if lanes not in self._linearised:
            self._linearised[lanes] = self.model.network(self.record, np.repeat(self.model.z()[None], lanes, axis=0))
            self._linearised[lanes].linearise_along(self.nodes)
        return self._linearised[lanes].copied()


def _score_test(fitted: Fitted, parts: FoldData, S: Array, permanent: bool) -> tuple[Array, float]:
    """Score test of columns S (M, k): their amounts (k,) beside the model's Jacobian, and the held-out sum of squares.

    What acts for a while is left out in short stretches, and its gain on them is taken for that on folds.
    """
    left_out = LEFT_OUT if permanent else EACH_FOLD
    full = parts.with_columns(S)
    own = full.H.shape[1] - S.shape[1]
    size = np.concatenate([np.ones(own), 1.0 / (np.sqrt((S**2).sum(axis=0)) + 1e-300)])
    ridge = block_diag(fitted.ridge, 1e-9 * np.eye(S.shape[1]))
    sized = full.scaled(size)
    solution = np.linalg.lstsq(sized.H.sum(axis=0) + ridge, sized.g.sum(axis=0), rcond=1e-12)[0]
    amounts = (solution * size)[own:]
    # the candidate's own coordinate is its amount: a fold that is left out may change it as much as it likes
    scaled = sized.moved(solution).scaled(np.concatenate([np.ones(own), np.abs(amounts) / size[own:]]))
    squares = float(scaled.held_out(ridge, left_out).sum())
    return amounts, squares if permanent else squares * float(fitted.held_out.sum() / fitted.held_out_stretches.sum())


def shortlist(screened: Sequence[Screened]) -> list[Screened]:
    """The best overall, the best of every cause with and without a driver, and of every law by every driver."""
    distinct: dict[tuple[object, ...], Screened] = {}
    for each in screened:
        mechanism = each.mechanism
        point = id(each.point) if mechanism.multistart else 0
        bounded = ends_within(mechanism)
        distinct.setdefault((type(mechanism), mechanism.key, len(mechanism.numbers), point, bounded), each)
    ordered = list(distinct.values())
    chosen = ordered[:_SHORTLIST]
    seen: dict[tuple[str, object], int] = {}
    started: dict[tuple[object, ...], int] = {}
    for each in ordered:
        cause, _, driver = each.mechanism.key
        windowed = ends_within(each.mechanism)
        numbers = len(each.mechanism.numbers) * each.mechanism.multistart
        # what has changed on a device that known-good records show is at one place
        several = len(each.mechanism.places) > 1 and each.mechanism.by_place and not each.point.records[0].known_good
        kinds: list[tuple[str, object]] = [
            ("cause", (sum(windowed), type(each.mechanism), driver == "", numbers, several))
        ]
        if any(windowed) and cause == "heat_source":
            kinds.append(("where", each.mechanism.places))
        if each.mechanism.adds_nodes:
            kinds.append(("where", (each.mechanism.places, numbers, windowed)))
        shape = (type(each.mechanism), len(each.mechanism.places), len(each.mechanism.numbers))
        if each.mechanism.multistart and started.get(shape, 0) < _STARTS:
            started[shape] = started.get(shape, 0) + 1
            chosen.append(each)
        scope = "driver of one" if len(each.mechanism.places) == 1 else "driver of several"
        scope = "tuned " * each.mechanism.tuned + scope
        if driver and "*" not in driver and len([key for key in seen if key[0] == scope]) < _DRIVERS:
            # a law with a further number says nothing of the plain one
            kinds.append((scope, (cause, driver, len(each.mechanism.numbers))))
        for kind in kinds:
            seen[kind] = seen.get(kind, 0) + 1
            if seen[kind] == 1:
                chosen.append(each)
    return list({id(each): each for each in chosen}.values())


def ends_within(mechanism: Mechanism) -> tuple[bool, bool]:
    """Whether it begins, and whether it ends, within the record."""
    return mechanism.onset_s is not None, mechanism.end_s is not None
