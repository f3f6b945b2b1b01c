"""The search: screen the zones, choose poles, select the sensors, fit the winners, search their circuits.

Everything that takes time goes through :class:`ResumablePool`; the rest is deterministic, however often it is run.

How many sensors to take: the fewest within one standard error of the best (Breiman et al. 1984, *Classification and
Regression Trees*, section 3.4.3). The standard error is that of the mean square over the blocks.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits import Circuit, assemble
from ambient_trainer.data import Array, Segment, Trace, segments
from ambient_trainer.estimation import CircuitStructure, FreeFilter, Structure
from ambient_trainer.estimation.validation import Block, cut_in_blocks, refitted
from ambient_trainer.estimators import estimate_degC, slowest_period_s, source_of
from ambient_trainer.lti import Hold, StateSpace, dc_gain, noise_gain
from ambient_trainer.selection.grams import Grams, Sensors, banks, best_sets, gathered
from ambient_trainer.selection.resumable import ResumablePool
from ambient_trainer.selection.screen import Sensor
from ambient_trainer.selection.topology import Topology, best_topology, can_be_named, circuit_of, pruned

NEAR_DEGC = 0.02
"""Errors this close are as good as each other; chosen, a fifth of what a sensor may be off."""
_CIRCUIT_SAMPLES = 10_000


@dataclass(frozen=True)
class Options:
    """What to search, and how; a state file belongs to one of these."""

    most: int = 6
    order: int = 4
    blocks: int = 10
    gap_s: float | None = None
    tolerance_degC: float = 0.1
    period_s: float | None = None


@dataclass(frozen=True)
class SearchData:
    """The traces on one grid, what may be chosen from them, and how; ``left_out`` says why a column may not."""

    traces: tuple[Trace, ...]
    sensors: tuple[Sensor, ...]
    left_out: Mapping[str, str]
    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]
    options: Options

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return tuple(each.name for each in self.sensors)

    @property
    def period_s(self) -> float:
        """Period of the grid."""
        return self.segments[0].period_s

    @property
    def simulated(self) -> bool:
        """Whether any of the traces says so."""
        return any(each.notes.get("simulated") == "yes" for each in self.traces)

    @property
    def circuit_period_s(self) -> float:
        """A multiple of the period that leaves no more samples than hundreds of circuits can be fitted to."""
        return self.period_s * math.ceil(sum(each.inputs.shape[1] for each in self.segments) / _CIRCUIT_SAMPLES)


@dataclass(frozen=True)
class ScoredSystem:
    """A continuous system with sum (degC^2) and number of squared errors of each held-out block.

    ``checks_degC`` are its RMSE on each trace without a part in the selection, from a cold start at the first sample.
    """

    system: StateSpace
    squares: tuple[float, ...]
    samples: tuple[float, ...]
    checks_degC: tuple[float, ...]

    @property
    def mean_square(self) -> float:
        """Over all held-out samples, in degC^2."""
        return sum(self.squares) / sum(self.samples)

    @property
    def rmse_degC(self) -> float:
        """The root of :attr:`mean_square`."""
        return float(np.sqrt(self.mean_square))

    @property
    def standard_error_degC2(self) -> float:
        """Standard error of the mean square, from its differences between blocks."""
        each = np.asarray(self.squares) / np.asarray(self.samples)
        return float(np.std(each, ddof=1) / np.sqrt(len(each)))

    @property
    def interval_degC(self) -> tuple[float, float]:
        """The RMSE one standard error down and up."""
        middle, error = self.mean_square, self.standard_error_degC2
        return float(np.sqrt(max(middle - error, 0.0))), float(np.sqrt(middle + error))


@dataclass(frozen=True)
class Alternative:
    """The error when the sensor ``into`` replaces ``out`` is higher by ``worse_degC``."""

    out: str
    into: str
    worse_degC: float


@dataclass(frozen=True)
class SelectedSet(ScoredSystem):
    """The best set of sensors of a size, or one to compare with, by a filter over fixed poles and a ``free`` one.

    ``noise_gain`` is the estimate's standard deviation per unit of noise, ``noise_degC`` what the sensors' own makes.
    """

    sensors: tuple[str, ...]
    noise_gain: float
    noise_degC: float
    free: ScoredSystem
    alternatives: tuple[Alternative, ...] = ()

    @property
    def dc_gains(self) -> tuple[float, ...]:
        """One a sensor."""
        return tuple(dc_gain(self.system)[0].tolist())


@dataclass(frozen=True)
class SelectedCircuit(ScoredSystem):
    """The best circuit of a size, fitted to everything, and how many topologies of this size were ``tried``."""

    circuit: Circuit
    topology: Topology
    tried: int


@dataclass(frozen=True)
class SearchResult:
    """What :func:`ambient_trainer.selection.search.searched` returns.

    ``sizes`` and ``circuits`` go by number of sensors, from one; ``unnamed`` are those that a circuit file cannot name.
    ``checks`` are the paths of the traces without a part in the selection.
    """

    data: SearchData
    poles_s: tuple[float, ...]
    sets_tried: int
    sizes: tuple[SelectedSet, ...]
    against: SelectedSet | None
    circuits: Mapping[int, SelectedCircuit]
    unnamed: tuple[str, ...]
    checks: tuple[str, ...]

    @property
    def sets(self) -> list[SelectedSet]:
        """Those of each size, and the one to compare with."""
        return [*self.sizes, *([self.against] if self.against else [])]

    @property
    def recommended(self) -> SelectedSet:
        """The smallest set within one standard error of the best."""
        best = min(self.sizes, key=lambda each: each.mean_square)
        return next(each for each in self.sizes if each.mean_square <= best.mean_square + best.standard_error_degC2)


def counted(sensors: int) -> str:
    """A number of sensors in words."""
    return f"{sensors} sensor{'s' * (sensors > 1)}"


def flat_from(errors: Sequence[float], gain_degC: float) -> int:
    """The first place after which no error is lower by more than ``gain_degC``."""
    return next(index for index, error in enumerate(errors) if error - min(errors[index:]) <= gain_degC)


_SAMPLES_PER_UNKNOWN = 10
_POLES_BY_SENSORS = 3
_SETS_AT_ONCE = 128
_SLOWEST_SHARE = 1 / 40
_FILTER = {"starts": 2, "whole": 200, "without_one": 12}
_CIRCUIT = {"starts": 1, "whole": 60, "without_one": 5}
"""Of hundreds: where a topology leaves a direction open a search would creep along it for long."""


def prepared(
    traces: Sequence[Trace], sensors: tuple[Sensor, ...], left_out: Mapping[str, str], options: Options
) -> SearchData:
    """Lay the usable ``sensors`` of ``traces`` on a grid; raises :class:`Refused` where nothing can be learned."""
    source = source_of(traces)
    if not sensors:
        whys = "; ".join(f"{column}: {why}" for column, why in left_out.items())
        raise refuse(source, "", f"no zone is usable ({whys})", "log others")
    for trace in traces:
        reference = trace.reference
        if np.isnan(reference).all() or np.nanmax(reference) == np.nanmin(reference):
            raise refuse(trace.path, f"column {REFERENCE}", "never changes", "log a run in which the ambient moves")
    laid = _on_grid(traces, sensors, options.period_s or slowest_period_s(traces))
    samples = sum(int(np.count_nonzero(~np.isnan(each.outputs[0]))) for each in laid)
    unknowns = min(options.most, len(sensors)) * (1 + options.order) + 1
    if samples < _SAMPLES_PER_UNKNOWN * unknowns:
        hint = f"log {_SAMPLES_PER_UNKNOWN} each, or ask for fewer sensors (--most) or states (--order)"
        raise refuse(source, "", f"{samples} samples for up to {unknowns} unknowns", hint)
    blocks = cut_in_blocks(laid, options.blocks, options.gap_s, source)
    left = min(samples - _known(laid, each.segment, each.first, each.last) for each in blocks)
    if left <= unknowns:
        problem = f"beside a block and its gaps {left} samples are left to fit up to {unknowns} unknowns"
        raise refuse(source, "", problem, "narrow the --gap, or ask for more --blocks")
    return SearchData(tuple(traces), sensors, left_out, laid, blocks, options)


def numbered(data: SearchData, names: Sequence[str]) -> Sensors:
    """The places of sensors by name; raises :class:`Refused` for one that is not among them."""
    for name in names:
        if name not in data.names:
            why = data.left_out.get(f"{name}_degC")
            problem = f"left out: {why}" if why else "no such sensor"
            raise refuse(source_of(data.traces), name, problem, f"take of {', '.join(data.names)}")
    return tuple(sorted(data.names.index(name) for name in names))


def searched(
    data: SearchData,
    pool: ResumablePool,
    against: Sequence[str] = (),
    checks: Sequence[Trace] = (),
    with_circuits: bool = True,
) -> SearchResult:
    """Search ``data`` for the best sets of sensors and their circuits.

    ``against`` names the sensors of a set to compare with; the traces of ``checks`` are scored and have no part in the
    selection. Raises :class:`Refused` where one of these lacks a sensor; nothing is computed then.
    """
    compared = numbered(data, against)
    for trace in checks:
        if np.isnan(trace.reference).all():
            raise refuse(trace.path, f"column {REFERENCE}", "holds no value at all", "log it, or check another trace")
        if absent := [each.column for each in data.sensors if each.column not in trace.columns]:
            raise refuse(trace.path, "line 1", f"no column {', '.join(absent)}", "check a trace of the same device")
    search = _Search(data, pool, checks)
    best = best_sets(range(len(data.sensors)), data.options.most, search.score)
    sets = search.selected([*best, compared] if compared else best)
    sizes = [replace(each, alternatives=search.alternatives(members)) for each, members in zip(sets, best)]
    unnamed = tuple(each for each in data.names if not can_be_named(each))
    circuits = search.circuits(unnamed) if with_circuits else {}
    given, paths = sets[-1] if compared else None, tuple(each.path for each in checks)
    return SearchResult(data, search.poles_s, len(search.errors), tuple(sizes), given, circuits, unnamed, paths)


_Fit = Callable[[Sequence[Topology]], dict[Topology, dict[str, Any]]]


class _Search:
    """The steps of a search: poles, sets of sensors, each scored once, and the circuits of the best."""

    def __init__(self, data: SearchData, pool: ResumablePool, checks: Sequence[Trace]) -> None:
        self.data, self.pool, self.options, self.checks = data, pool, data.options, checks
        self.errors: dict[Sensors, float] = {}
        """The held-out RMSE in degC of every set that was tried."""
        gather = partial(gathered, data.segments, data.blocks, data.sensors, tolerance_degC=data.options.tolerance_degC)
        # over the best poles the best few sensors leave the least error
        longest_s = max(each.inputs.shape[1] for each in data.segments) * data.period_s
        offered = banks(data.options.order, data.period_s, longest_s)
        few = min(data.options.most, _POLES_BY_SENSORS)
        errors = pool.results("fixed poles", partial(_pole_errors, gather, len(data.sensors), few), offered)
        self.poles_s = min(offered, key=lambda each: (errors[each], each))
        self.grams: Grams = gather(poles_s=self.poles_s)

    def score(self, candidates: Sequence[Sensors]) -> list[float]:
        """The held-out RMSE in degC of sets of one size."""
        missing = [each for each in candidates if each not in self.errors]
        if missing:
            what, name = f"sets of {counted(len(missing[0]))}", f"set {self.poles_s}"
            self.errors.update(self.pool.results(what, self.grams.rmse_degC, missing, _SETS_AT_ONCE, name))
        return [self.errors[each] for each in candidates]

    def selected(self, sets: Sequence[Sensors]) -> list[SelectedSet]:
        """The sets, with their filters and errors."""
        structure_of = partial(_free_filter, self.data.segments, self.options.order)
        fits = self.pool.results("free filters", partial(_fits, structure_of, self.data.blocks, _FILTER), sets)
        samples = tuple(self.grams.samples.tolist())
        found = []
        for members in sets:
            sensors, fit = [self.data.sensors[each] for each in members], fits[members]
            columns, noises = tuple(each.column for each in sensors), np.array([each.noise_degC for each in sensors])
            fixed, free = self.grams.fitted(members), structure_of(members).system(*_unknowns(fit))
            noisy = replace(fixed, B=fixed.B * noises, D=fixed.D * noises)
            gain, noise_degC = (noise_gain(each, self.data.period_s) for each in (fixed, noisy))
            squares, names = tuple(self.grams.squares([members])[0].tolist()), tuple(each.name for each in sensors)
            checks_degC, of_free = (self.on_checks(each, "first-order", columns) for each in (fixed, free))
            rival = ScoredSystem(free, fit["squares"], samples, of_free)
            found.append(SelectedSet(fixed, squares, samples, checks_degC, names, gain, noise_degC, rival))
        return found

    def on_checks(self, system: StateSpace, hold: Hold, columns: Sequence[str]) -> tuple[float, ...]:
        """RMSE in degC on each trace to check on."""
        errors = (each.reference - estimate_degC(system, hold, columns, each) for each in self.checks)
        return tuple(float(np.sqrt(np.nanmean(error**2))) for error in errors)

    def alternatives(self, members: Sensors) -> tuple[Alternative, ...]:
        """The swaps of one sensor that cost little, by sensor and cost."""
        names = self.data.names
        moves = [(out, new) for out in members for new in range(len(names)) if new not in members]
        swapped = [tuple(sorted({*members, new} - {out})) for out, new in moves]
        own, *others = self.score([members, *swapped])
        near = sorted((out, error - own, new) for (out, new), error in zip(moves, others))
        return tuple(Alternative(names[out], names[new], worse) for out, worse, new in near if worse <= NEAR_DEGC)

    def circuits(self, unnamed: Sequence[str]) -> dict[int, SelectedCircuit]:
        """Per size the best circuit of the best sensors that a circuit file can name."""
        data, options = self.data, self.options
        coarse = _on_grid(data.traces, data.sensors, data.circuit_period_s)
        blocks = cut_in_blocks(coarse, options.blocks, options.gap_s, source_of(data.traces))
        # time constants to start from, slowest first
        longest_s = max(each.inputs.shape[1] * each.period_s for each in coarse)
        slowest_s = max(_SLOWEST_SHARE * longest_s, self.poles_s[0])
        tau_s = tuple(np.geomspace(slowest_s, self.poles_s[0], max(options.order, 2)).tolist())
        structure_of = partial(circuit_structure, coarse, data.names, tau_s)
        task = partial(_fits, structure_of, blocks, _CIRCUIT)
        samples = tuple(float(_known(coarse, each.segment, each.start, each.stop)) for each in blocks)
        found = {}
        allowed = [index for index, name in enumerate(data.names) if name not in unnamed]
        for members in best_sets(allowed, options.most, self.score):
            fit = partial(self.pool.results, f"circuits of {counted(len(members))}", task)
            names = [data.names[each] for each in members]
            found[len(members)] = self._best_circuit(fit, structure_of, names, samples)
        return found

    def _best_circuit(
        self, fit: _Fit, structure_of: partial[CircuitStructure], names: Sequence[str], samples: tuple[float, ...]
    ) -> SelectedCircuit:
        fits: dict[Topology, dict[str, Any]] = {}

        def score(topologies: Sequence[Topology]) -> list[float]:
            fits.update(fit(topologies))
            return [math.sqrt(sum(fits[each]["squares"]) / sum(samples)) for each in topologies]

        topology = best_topology(names, self.options.order, score)
        best, structure = fits[topology], structure_of(topology)
        about = (
            f"Found by a search over {len(fits)} circuits of {', '.join(names)}; "
            f"{score([topology])[0]:.3g} degC off on blocks of time that it was not fitted to"
        )
        named = replace(structure.circuit, name=f"search_{len(names)}", about=about)
        circuit, less = pruned(named, topology, structure.values(*_unknowns(best)))
        system = assemble(circuit, {each.name: each.initial for each in circuit.parameters}).value
        checks_degC = self.on_checks(system, circuit.hold, circuit.inputs)
        return SelectedCircuit(system, best["squares"], samples, checks_degC, circuit, less, len(fits))


def _pole_errors(gather: partial[Grams], sensors: int, few: int, keys: Sequence[tuple[float, ...]]) -> list[float]:
    """Per set of poles the held-out RMSE in degC of the best few of the sensors."""
    scores = [gather(poles_s=key).rmse_degC for key in keys]
    return [min(score([each])[0] for each in best_sets(range(sensors), few, score)) for score in scores]


def _fits(
    structure_of: Callable[[Any], Structure], blocks: Sequence[Block], spending: dict[str, int], keys: Sequence[Any]
) -> list[dict[str, Any]]:
    """Per key the unknowns of its structure, and the sum of squares of each block that was left out."""
    found = []
    for best, squares in (refitted(structure_of(key), blocks, **spending) for key in keys):
        found.append({"theta": best.theta.tolist(), "beta": best.beta.tolist(), "squares": list(squares)})
    return found


def _free_filter(laid: Sequence[Segment], order: int, members: Sensors) -> FreeFilter:
    return FreeFilter(order, [each.of(members) for each in laid])


def circuit_structure(
    laid: Sequence[Segment], names: Sequence[str], tau_s: Sequence[float], topology: Topology
) -> CircuitStructure:
    """The circuit of a topology over segments that hold the sensors ``names``, in this order."""
    circuit = circuit_of(topology, tau_s, "candidate", "candidate")
    # a circuit orders its inputs by its nodes
    rows = [names.index(each.removesuffix("_degC")) for each in circuit.inputs]
    return CircuitStructure(circuit, [each.of(rows) for each in laid])


def _unknowns(fit: dict[str, Any]) -> tuple[Array, Array]:
    return np.array(fit["theta"]), np.array(fit["beta"])


def _on_grid(traces: Sequence[Trace], sensors: Sequence[Sensor], period_s: float) -> tuple[Segment, ...]:
    columns = [each.column for each in sensors]
    return tuple(each for trace in traces for each in segments(trace, columns, [REFERENCE], period_s))


def _known(laid: Sequence[Segment], segment: int, start: int, stop: int) -> int:
    """How many samples from ``start`` to ``stop`` of a segment have a reference."""
    return int(np.count_nonzero(~np.isnan(laid[segment].outputs[0, start:stop])))
