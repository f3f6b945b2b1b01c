"""The search: screen the zones, choose a bank, select the sensors, fit the winners, wire them.

Everything that takes time goes through :class:`Work`; what stands here is the same, however often it is run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.data.grid import Segment, sampling_period_s, segments
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.blocks import Block, cut_in_blocks
from ambient_trainer.selection.bank import banks
from ambient_trainer.selection.check import checked, fit_to_check
from ambient_trainer.selection.fitted import fitted_circuit
from ambient_trainer.selection.forward import best_sets, swaps
from ambient_trainer.selection.found import Alternative, Chosen, Found, FoundCircuit, FreeFit, Options
from ambient_trainer.selection.front import HeldOut, fewest_within_one_error
from ambient_trainer.selection.grams import Grams, Sensors, gathered
from ambient_trainer.selection.screen import LeftOut, Screened, Sensor
from ambient_trainer.selection.stepwise import best_wiring
from ambient_trainer.selection.tasks import (
    BankScores,
    FreeFits,
    SetScores,
    WiringFits,
    bank_key,
    candidate_of,
    key_of,
    wiring_error,
)
from ambient_trainer.selection.wiring import Wiring, can_be_named, circuit_of
from ambient_trainer.selection.work import Work

NEAR_DEGC = 0.02
"""Within this two sets are as good as each other."""
_SAMPLES_PER_UNKNOWN = 10
_BANK_SENSORS = 3
_SETS_AT_ONCE = 128
_CIRCUIT_SAMPLES = 10_000
_TIMES_SHOWN = 40


@dataclass(frozen=True)
class Data:
    """The traces on one grid, and what may be chosen from them."""

    traces: tuple[Trace, ...]
    sensors: tuple[Sensor, ...]
    left_out: tuple[LeftOut, ...]
    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The sensors'."""
        return tuple(each.name for each in self.sensors)

    @property
    def period_s(self) -> float:
        """The grid's."""
        return self.segments[0].period_s

    @property
    def samples(self) -> tuple[float, ...]:
        """With a reference, by block."""
        return tuple(
            float(np.count_nonzero(~np.isnan(self.segments[each.segment].outputs[0, each.start : each.stop])))
            for each in self.blocks
        )

    def numbers(self, names: Sequence[str]) -> Sensors:
        """The places of sensors by name; raises :class:`Refused` for one that is not among them."""
        out = {each.column.removesuffix("_degC"): each.why for each in self.left_out}
        for name in names:
            if name not in self.names:
                problem = f"left out: {out[name]}" if name in out else "no such sensor"
                source = ", ".join(each.path for each in self.traces)
                raise refuse(source, name, problem, f"take of {', '.join(self.names)}")
        return tuple(sorted(self.names.index(name) for name in names))


def prepared(traces: Sequence[Trace], zones: Screened, options: Options) -> Data:
    """Lay the usable ``zones`` of ``traces`` on a grid; raises :class:`Refused` where nothing can be learned."""
    sensors, left_out = zones
    source = ", ".join(each.path for each in traces)
    if not sensors:
        whys = "; ".join(f"{each.column}: {each.why}" for each in left_out)
        raise refuse(source, "", f"no zone can teach anything ({whys})", "log others")
    for trace in traces:
        reference = trace.reference
        if np.isnan(reference).all() or np.nanmax(reference) == np.nanmin(reference):
            raise refuse(trace.path, f"column {REFERENCE}", "never changes", "log a run in which the ambient moves")
    period_s = options.period_s or max(sampling_period_s(each.time_s) for each in traces)
    laid = _laid(traces, sensors, period_s)
    samples = sum(int(np.count_nonzero(~np.isnan(each.outputs[0]))) for each in laid)
    unknowns = min(options.most, len(sensors)) * (1 + options.order) + 1
    if samples < _SAMPLES_PER_UNKNOWN * unknowns:
        mend = f"log {_SAMPLES_PER_UNKNOWN} each, or ask for fewer sensors (--most) or states (--order)"
        raise refuse(source, "", f"{samples} samples for up to {unknowns} unknowns", mend)
    blocks = cut_in_blocks(laid, options.blocks, options.gap_s, source)
    left = min(samples - _untaught(laid[each.segment], each) for each in blocks)
    if left <= unknowns:
        problem = f"beside a block and its gaps {left} samples are left to teach up to {unknowns} unknowns"
        raise refuse(source, "", problem, "narrow the --gap, or ask for more --blocks")
    return Data(tuple(traces), sensors, left_out, laid, blocks)


def _untaught(segment: Segment, block: Block) -> int:
    """How many samples with a reference lie in the block and its gaps."""
    return int(np.count_nonzero(~np.isnan(segment.outputs[0, block.first : block.last])))


def searched(
    data: Data,
    options: Options,
    work: Work,
    against: Sequence[str] = (),
    checks: Sequence[Trace] = (),
    with_circuits: bool = True,
) -> Found:
    """Search ``data``; ``against`` names a set to compare with, ``checks`` are scored and choose nothing."""
    named = data.numbers(against)
    for each in checks:
        fit_to_check(each, data.sensors)
    poles_s = _bank(data, options, work)
    grams = gathered(data.segments, data.blocks, data.sensors, poles_s, options.tolerance_degC)
    task = SetScores(grams)
    selection = _Selection(task, work)
    everyone = range(len(data.sensors))
    best = selection.best(everyone, options.most)
    wanted = [*best, named] if named else best
    fits = _free_fits(data, options, work, wanted)
    sizes = tuple(_chosen(data, grams, each, fits[each], selection.near(each, everyone)) for each in best)
    unnamed = [each for each in data.names if not can_be_named(each)]
    circuits = _circuits(data, options, work, selection, poles_s, unnamed) if with_circuits else {}
    found = Found(
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
        sets_tried=selection.tried,
        sizes=sizes,
        named=fewest_within_one_error([each.held_out for each in sizes]),
        against=_chosen(data, grams, named, fits[named], {}) if named else None,
        circuits=circuits,
        unnamed=tuple(unnamed),
        checks=(),
    )
    return replace(found, checks=tuple(checked(found, each) for each in checks))


class _Selection:
    """Sets of sensors, scored once each."""

    def __init__(self, task: SetScores, work: Work) -> None:
        self.task = task
        self.work = work
        self._known: dict[str, float] = {}

    @property
    def tried(self) -> int:
        """How many sets were scored."""
        return len(self._known)

    def score(self, candidates: Sequence[Sensors]) -> list[float]:
        keys = [key_of(each) for each in candidates]
        missing = [each for each in keys if each not in self._known]
        if missing:
            size = len(candidate_of(missing[0]))
            what = f"sets of {size} sensor{'s' * (size > 1)}"
            self._known.update(self.work.results(what, self.task, missing, _SETS_AT_ONCE))
        return [self._known[each] for each in keys]

    def best(self, allowed: Sequence[int], most: int) -> list[Sensors]:
        return best_sets(allowed, most, self.score)

    def near(self, members: Sensors, allowed: Sequence[int]) -> dict[tuple[int, int], float]:
        """Per (out, in) by how much a swap is worse, where that is little."""
        moves = swaps(members, allowed)
        own, *others = self.score([members, *(each for _, _, each in moves)])
        return {(out, new): error - own for (out, new, _), error in zip(moves, others) if error - own <= NEAR_DEGC}


def _laid(traces: Sequence[Trace], sensors: Sequence[Sensor], period_s: float) -> tuple[Segment, ...]:
    columns = [each.column for each in sensors]
    return tuple(each for trace in traces for each in segments(trace, columns, [REFERENCE], period_s))


def _bank(data: Data, options: Options, work: Work) -> tuple[float, ...]:
    """The bank over which the best few sensors leave the least."""
    longest_s = max(each.inputs.shape[1] for each in data.segments) * data.period_s
    offered = banks(options.order, data.period_s, longest_s)
    few = min(options.most, _BANK_SENSORS)
    task = BankScores(data.segments, data.blocks, data.sensors, options.tolerance_degC, few)
    errors = work.results("banks of poles", task, [bank_key(each) for each in offered], 1)
    return min(offered, key=lambda each: (errors[bank_key(each)], each))


def _free_fits(
    data: Data, options: Options, work: Work, sets: Sequence[Sensors]
) -> dict[Sensors, tuple[FreeFits, dict[str, Any]]]:
    task = FreeFits(data.segments, data.blocks, options.order)
    found = work.results("free filters", task, [key_of(each) for each in sets], 1)
    return {each: (task, found[key_of(each)]) for each in sets}


def _chosen(
    data: Data,
    grams: Grams,
    members: Sensors,
    fit: tuple[FreeFits, dict[str, Any]],
    near: Mapping[tuple[int, int], float],
) -> Chosen:
    task, value = fit
    fitted = grams.fitted(members)
    names = data.names
    return Chosen(
        sensors=tuple(names[each] for each in members),
        filter=fitted,
        held_out=HeldOut(tuple(grams.squares([members])[0].tolist()), data.samples),
        noise_gain=fitted.noise_gain(data.period_s),
        noise_degC=fitted.noise_degC([data.sensors[each].noise_degC for each in members], data.period_s),
        free=FreeFit(
            task.structure(members).system(np.array(value["theta"]), np.array(value["beta"])),
            tuple(data.sensors[each].column for each in members),
            HeldOut(tuple(value["squares"]), data.samples),
        ),
        alternatives=tuple(
            Alternative(names[out], names[new], worse)
            for (out, new), worse in sorted(near.items(), key=lambda each: (each[0][0], each[1]))
        ),
    )


def _circuit_period_s(data: Data) -> float:
    """A multiple of the period that leaves no more samples than hundreds of circuits can be fitted to."""
    total = sum(each.inputs.shape[1] for each in data.segments)
    return data.period_s * math.ceil(total / _CIRCUIT_SAMPLES)


def _circuits(
    data: Data,
    options: Options,
    work: Work,
    selection: _Selection,
    poles_s: tuple[float, ...],
    unnamed: Sequence[str],
) -> dict[int, FoundCircuit]:
    """Per size the best circuit of the best sensors that a circuit file can name."""
    allowed = [index for index, name in enumerate(data.names) if name not in unnamed]
    coarse = _laid(data.traces, data.sensors, _circuit_period_s(data))
    source = ", ".join(each.path for each in data.traces)
    blocks = cut_in_blocks(coarse, options.blocks, options.gap_s, source)
    whole = replace(data, segments=coarse, blocks=blocks)
    task = WiringFits(coarse, blocks, data.names, _starting_tau_s(coarse, poles_s[0], options.order))
    found = {}
    for members in selection.best(allowed, options.most):
        names = [data.names[each] for each in members]
        found[len(names)] = _best_circuit(task, work, names, whole.samples, options.order)
    return found


def _starting_tau_s(laid: Sequence[Segment], fastest_s: float, states: int) -> tuple[float, ...]:
    """Time constants to start from, slowest first: from what a stretch shows forty times to the bank's fastest."""
    longest_s = max(each.inputs.shape[1] * each.period_s for each in laid)
    slowest_s = max(longest_s / _TIMES_SHOWN, fastest_s)
    return tuple(np.geomspace(slowest_s, fastest_s, max(states, 2)).tolist())


def _best_circuit(
    task: WiringFits, work: Work, names: Sequence[str], samples: tuple[float, ...], order: int
) -> FoundCircuit:
    fits: dict[str, Any] = {}

    def score(wirings: Sequence[Wiring]) -> list[float]:
        keys = [each.text for each in wirings]
        what = f"circuits of {len(names)} sensor{'s' * (len(names) > 1)}"
        fits.update(work.results(what, task, keys, 1))
        return [wiring_error(fits[key], sum(samples)) for key in keys]

    wiring = best_wiring(names, order, score)
    value = fits[wiring.text]
    held_out = HeldOut(tuple(value["squares"]), samples)
    structure = task.structure(wiring)
    theta, beta = np.array(value["theta"]), np.array(value["beta"])
    about = (
        f"Found by a search over {len(fits)} circuits of {', '.join(names)}; "
        f"{held_out.rmse_degC:.3g} degC off on blocks of time that it was not fitted to"
    )
    drawn = circuit_of(wiring, task.tau_s, f"search_{len(names)}", about)
    circuit, less = fitted_circuit(drawn, wiring, structure.values(theta, beta))
    system = assemble(circuit, {each.name: each.initial for each in circuit.parameters}).value
    return FoundCircuit(circuit, less, system, held_out, len(fits))
