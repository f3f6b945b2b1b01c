"""The search: screen the zones, choose poles, select the sensors, fit the winners, search their circuits.

Everything that takes time goes through :class:`ResumablePool`; the rest is deterministic, however often it is run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.data.grid import Segment, sampling_period_s, segments
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.structure import Structure
from ambient_trainer.estimation.validation import Block, Spending, cut_in_blocks, refitted
from ambient_trainer.estimators.training import source_of
from ambient_trainer.lti.response import noise_gain
from ambient_trainer.selection.floating import best_sets, swaps
from ambient_trainer.selection.grams import Grams, Sensors, banks, gathered
from ambient_trainer.selection.result import (
    NEAR_DEGC,
    Alternative,
    Options,
    ScoredSystem,
    SearchResult,
    SelectedCircuit,
    SelectedSet,
    TraceScores,
)
from ambient_trainer.selection.resumable import ResumablePool
from ambient_trainer.selection.screen import LeftOut, Screened, Sensor
from ambient_trainer.selection.topology import Topology, best_topology, can_be_named, circuit_of, pruned

_SAMPLES_PER_UNKNOWN = 10
_POLES_BY_SENSORS = 3
_SETS_AT_ONCE = 128
_CIRCUIT_SAMPLES = 10_000
_SLOWEST_SHARE = 1 / 40
_FILTER = Spending(starts=2, whole=200, without=12)
_CIRCUIT = Spending(starts=1, whole=60, without=5)
"""Of hundreds: where a topology leaves a direction open a search would creep along it for long."""


@dataclass(frozen=True)
class SearchData:
    """The traces on one grid, and what may be chosen from them."""

    traces: tuple[Trace, ...]
    sensors: tuple[Sensor, ...]
    left_out: tuple[LeftOut, ...]
    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return tuple(each.name for each in self.sensors)

    @property
    def period_s(self) -> float:
        """Period of the grid."""
        return self.segments[0].period_s

    @property
    def samples(self) -> tuple[float, ...]:
        """With a reference, by block."""
        return tuple(float(_scored(self.segments, each, each.start, each.stop)) for each in self.blocks)

    def numbers(self, names: Sequence[str]) -> Sensors:
        """The places of sensors by name; raises :class:`Refused` for one that is not among them."""
        out = {each.column.removesuffix("_degC"): each.why for each in self.left_out}
        for name in names:
            if name not in self.names:
                problem = f"left out: {out[name]}" if name in out else "no such sensor"
                raise refuse(source_of(self.traces), name, problem, f"take of {', '.join(self.names)}")
        return tuple(sorted(self.names.index(name) for name in names))


def prepared(traces: Sequence[Trace], zones: Screened, options: Options) -> SearchData:
    """Lay the usable ``zones`` of ``traces`` on a grid; raises :class:`Refused` where nothing can be learned."""
    sensors, left_out = zones
    source = source_of(traces)
    if not sensors:
        whys = "; ".join(f"{each.column}: {each.why}" for each in left_out)
        raise refuse(source, "", f"no zone is usable ({whys})", "log others")
    for trace in traces:
        reference = trace.reference
        if np.isnan(reference).all() or np.nanmax(reference) == np.nanmin(reference):
            raise refuse(trace.path, f"column {REFERENCE}", "never changes", "log a run in which the ambient moves")
    period_s = options.period_s or max(sampling_period_s(each.time_s) for each in traces)
    laid = _on_grid(traces, sensors, period_s)
    samples = sum(int(np.count_nonzero(~np.isnan(each.outputs[0]))) for each in laid)
    unknowns = min(options.most, len(sensors)) * (1 + options.order) + 1
    if samples < _SAMPLES_PER_UNKNOWN * unknowns:
        hint = f"log {_SAMPLES_PER_UNKNOWN} each, or ask for fewer sensors (--most) or states (--order)"
        raise refuse(source, "", f"{samples} samples for up to {unknowns} unknowns", hint)
    blocks = cut_in_blocks(laid, options.blocks, options.gap_s, source)
    left = min(samples - _scored(laid, each, each.first, each.last) for each in blocks)
    if left <= unknowns:
        problem = f"beside a block and its gaps {left} samples are left to fit up to {unknowns} unknowns"
        raise refuse(source, "", problem, "narrow the --gap, or ask for more --blocks")
    return SearchData(tuple(traces), sensors, left_out, laid, blocks)


def searched(
    data: SearchData,
    options: Options,
    pool: ResumablePool,
    against: Sequence[str] = (),
    checks: Sequence[Trace] = (),
    with_circuits: bool = True,
) -> SearchResult:
    """Search ``data``, :func:`prepared` with the same options, for the best sets of sensors and their circuits.

    ``against`` names the sensors of a set to compare with; the traces of ``checks`` are scored and have no part in the
    selection. Raises :class:`Refused` where one of these lacks a sensor; nothing is computed then.
    """
    compared = data.numbers(against)
    for trace in checks:
        _check_scorable(trace, data.sensors)
    poles_s = _best_poles(data, options, pool)
    grams = gathered(data.segments, data.blocks, data.sensors, poles_s, options.tolerance_degC)
    selection = _Selection(grams, pool)
    everyone = range(len(data.sensors))
    best = selection.best(everyone, options.most)
    free_filter = partial(_free_filter, data.segments, options.order)
    fits = pool.results(
        "free filters", partial(_fits, free_filter, data.blocks, _FILTER), [*best, compared] if compared else best
    )

    def selected(members: Sensors, alternatives: Sequence[Alternative] = ()) -> SelectedSet:
        return _selected(data, grams, members, free_filter(members), fits[members], alternatives)

    sizes = tuple(selected(each, _alternatives(data, selection, each)) for each in best)
    compared_set = selected(compared) if compared else None
    unnamed = tuple(each for each in data.names if not can_be_named(each))
    circuits = _circuits(data, options, pool, selection, poles_s, unnamed) if with_circuits else {}
    return SearchResult(
        traces=tuple(each.path for each in data.traces),
        simulated=any(each.notes.get("simulated") == "yes" for each in data.traces),
        options=options,
        sensors=data.sensors,
        left_out=data.left_out,
        period_s=data.period_s,
        circuit_period_s=_circuit_period_s(data),
        poles_s=poles_s,
        blocks=len(data.blocks),
        block_s=float(np.median([each.stop - each.start for each in data.blocks])) * data.period_s,
        gap_s=max(each.start - each.first for each in data.blocks) * data.period_s,
        sets_tried=len(selection.errors),
        sizes=sizes,
        against=compared_set,
        circuits=circuits,
        unnamed=unnamed,
        checks=tuple(_scores_on(each, sizes, circuits, compared_set) for each in checks),
    )


class _Selection:
    """Sets of sensors, each scored once."""

    def __init__(self, grams: Grams, pool: ResumablePool) -> None:
        self.errors: dict[Sensors, float] = {}
        self._grams = grams
        self._pool = pool

    def score(self, candidates: Sequence[Sensors]) -> list[float]:
        missing = [each for each in candidates if each not in self.errors]
        if missing:
            what, name = f"sets of {_counted(len(missing[0]))}", f"set {self._grams.poles_s}"
            self.errors.update(self._pool.results(what, self._grams.rmse_degC, missing, _SETS_AT_ONCE, name))
        return [self.errors[each] for each in candidates]

    def best(self, allowed: Sequence[int], most: int) -> list[Sensors]:
        return best_sets(allowed, most, self.score)


def _alternatives(data: SearchData, selection: _Selection, members: Sensors) -> list[Alternative]:
    """The swaps of one sensor that cost little, by sensor and cost."""
    moves = swaps(members, range(len(data.sensors)))
    own, *others = selection.score([members, *(each for _, _, each in moves)])
    near = [(out, error - own, new) for (out, new, _), error in zip(moves, others) if error - own <= NEAR_DEGC]
    return [
        Alternative(data.names[out], data.names[new], worse)
        for out, worse, new in sorted(near, key=lambda each: each[:2])
    ]


def _best_poles(data: SearchData, options: Options, pool: ResumablePool) -> tuple[float, ...]:
    """The poles over which the best few sensors leave the least error."""
    longest_s = max(each.inputs.shape[1] for each in data.segments) * data.period_s
    offered = banks(options.order, data.period_s, longest_s)
    few = min(options.most, _POLES_BY_SENSORS)
    gathering = partial(gathered, data.segments, data.blocks, data.sensors, tolerance_degC=options.tolerance_degC)
    errors = pool.results("fixed poles", partial(_pole_errors, gathering, len(data.sensors), few), offered)
    return min(offered, key=lambda each: (errors[each], each))


def _pole_errors(gathering: partial[Grams], sensors: int, few: int, keys: Sequence[tuple[float, ...]]) -> list[float]:
    """Per set of poles the held-out RMSE in degC of the best few of the sensors."""
    scores = [gathering(poles_s=key).rmse_degC for key in keys]
    return [min(score([each])[0] for each in best_sets(range(sensors), few, score)) for score in scores]


def _fits(
    structure_of: Callable[[Any], Structure], blocks: Sequence[Block], spending: Spending, keys: Sequence[Any]
) -> list[dict[str, Any]]:
    """Per key the unknowns of its structure, and the sum of squares of each block that was left out."""
    fits = [refitted(structure_of(key), blocks, spending) for key in keys]
    return [
        {"theta": each.solution.theta.tolist(), "beta": each.solution.beta.tolist(), "squares": list(each.squares)}
        for each in fits
    ]


def _free_filter(laid: Sequence[Segment], order: int, members: Sensors) -> FreeFilter:
    return FreeFilter(order, _rows_of(laid, members))


def circuit_structure(
    laid: Sequence[Segment], names: Sequence[str], tau_s: Sequence[float], topology: Topology
) -> CircuitStructure:
    """The circuit of a topology over segments that hold the sensors ``names``, in this order."""
    circuit = circuit_of(topology, tau_s, "candidate", "candidate")
    # a circuit orders its inputs by its nodes
    return CircuitStructure(
        circuit, _rows_of(laid, [names.index(each.removesuffix("_degC")) for each in circuit.inputs])
    )


def _rows_of(laid: Sequence[Segment], rows: Sequence[int]) -> list[Segment]:
    return [replace(each, inputs=each.inputs[list(rows)]) for each in laid]


def _selected(
    data: SearchData,
    grams: Grams,
    members: Sensors,
    structure: FreeFilter,
    fit: dict[str, Any],
    alternatives: Sequence[Alternative],
) -> SelectedSet:
    fixed, free = grams.fitted(members), structure.system(np.array(fit["theta"]), np.array(fit["beta"]))
    sensors = [data.sensors[each] for each in members]
    columns, noises = tuple(each.column for each in sensors), np.array([each.noise_degC for each in sensors])
    squares = tuple(grams.squares([members])[0].tolist())
    return SelectedSet(
        sensors=tuple(each.name for each in sensors),
        fixed=ScoredSystem(fixed, "first-order", columns, squares, data.samples),
        noise_gain=noise_gain(fixed, data.period_s),
        noise_degC=noise_gain(replace(fixed, B=fixed.B * noises, D=fixed.D * noises), data.period_s),
        free=ScoredSystem(free, "first-order", columns, tuple(fit["squares"]), data.samples),
        alternatives=tuple(alternatives),
    )


def _circuits(
    data: SearchData,
    options: Options,
    pool: ResumablePool,
    selection: _Selection,
    poles_s: tuple[float, ...],
    unnamed: Sequence[str],
) -> dict[int, SelectedCircuit]:
    """Per size the best circuit of the best sensors that a circuit file can name."""
    allowed = [index for index, name in enumerate(data.names) if name not in unnamed]
    coarse = _on_grid(data.traces, data.sensors, _circuit_period_s(data))
    blocks = cut_in_blocks(coarse, options.blocks, options.gap_s, source_of(data.traces))
    samples = tuple(float(_scored(coarse, each, each.start, each.stop)) for each in blocks)
    # time constants to start from, slowest first
    longest_s = max(each.inputs.shape[1] * each.period_s for each in coarse)
    slowest_s = max(_SLOWEST_SHARE * longest_s, poles_s[0])
    tau_s = tuple(np.geomspace(slowest_s, poles_s[0], max(options.order, 2)).tolist())
    structure_of = partial(circuit_structure, coarse, data.names, tau_s)
    found = {}
    for members in selection.best(allowed, options.most):
        what = f"circuits of {_counted(len(members))}"
        fit = partial(pool.results, what, partial(_fits, structure_of, blocks, _CIRCUIT))
        found[len(members)] = _best_circuit(fit, structure_of, [data.names[each] for each in members], samples, options)
    return found


def _best_circuit(
    fit: Callable[[Sequence[Topology]], dict[Topology, dict[str, Any]]],
    structure_of: partial[CircuitStructure],
    names: Sequence[str],
    samples: tuple[float, ...],
    options: Options,
) -> SelectedCircuit:
    fits: dict[Topology, dict[str, Any]] = {}

    def score(topologies: Sequence[Topology]) -> list[float]:
        fits.update(fit(topologies))
        return [math.sqrt(sum(fits[each]["squares"]) / sum(samples)) for each in topologies]

    topology = best_topology(names, options.order, score)
    best, structure = fits[topology], structure_of(topology)
    about = (
        f"Found by a search over {len(fits)} circuits of {', '.join(names)}; "
        f"{score([topology])[0]:.3g} degC off on blocks of time that it was not fitted to"
    )
    named = replace(structure.circuit, name=f"search_{len(names)}", about=about)
    values = structure.values(np.array(best["theta"]), np.array(best["beta"]))
    circuit, less = pruned(named, topology, values)
    system = assemble(circuit, {each.name: each.initial for each in circuit.parameters}).value
    scored = ScoredSystem(system, circuit.hold, circuit.inputs, tuple(best["squares"]), samples)
    return SelectedCircuit(circuit, less, scored, len(fits))


def _scores_on(
    trace: Trace, sizes: Sequence[SelectedSet], circuits: dict[int, SelectedCircuit], against: SelectedSet | None
) -> TraceScores:
    return TraceScores(
        path=trace.path,
        fixed=tuple(each.fixed.rmse_on(trace) for each in sizes),
        free=tuple(each.free.rmse_on(trace) for each in sizes),
        circuits={size: each.scored.rmse_on(trace) for size, each in circuits.items()},
        against=(against.fixed.rmse_on(trace), against.free.rmse_on(trace)) if against else None,
    )


def _check_scorable(trace: Trace, sensors: Sequence[Sensor]) -> None:
    """Refuse, before any work, a trace on which not every one of ``sensors`` could be scored."""
    if np.isnan(trace.reference).all():
        raise refuse(trace.path, f"column {REFERENCE}", "holds no value at all", "log it, or check another trace")
    absent = [each.column for each in sensors if each.column not in trace.columns]
    if absent:
        raise refuse(trace.path, "line 1", f"no column {', '.join(absent)}", "check a trace of the same device")


def _on_grid(traces: Sequence[Trace], sensors: Sequence[Sensor], period_s: float) -> tuple[Segment, ...]:
    columns = [each.column for each in sensors]
    return tuple(each for trace in traces for each in segments(trace, columns, [REFERENCE], period_s))


def _circuit_period_s(data: SearchData) -> float:
    """A multiple of the period that leaves no more samples than hundreds of circuits can be fitted to."""
    total = sum(each.inputs.shape[1] for each in data.segments)
    return data.period_s * math.ceil(total / _CIRCUIT_SAMPLES)


def _scored(laid: Sequence[Segment], block: Block, start: int, stop: int) -> int:
    """How many samples from ``start`` to ``stop`` of the block's segment have a reference."""
    return int(np.count_nonzero(~np.isnan(laid[block.segment].outputs[0, start:stop])))


def _counted(sensors: int) -> str:
    return f"{sensors} sensor{'s' * (sensors > 1)}"
