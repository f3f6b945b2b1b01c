"""The report of the tests of identifiability."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

from ambient_trainer.evaluation.identifiability import CLOSE_PERCENT, MOVED, SAME_PERCENT, Identifiability
from ambient_trainer.evaluation.sensitivity import INSENSITIVE_DEGC
from ambient_trainer.report import Finding, Report, Section, Table

_AS_THEY_ARE = "circuit", "trace", "held", "at_bound", "rmse_degC", "identifiable"
"""Of the tests, in their JSON."""


def report_of(found: Identifiability) -> Report:
    """The report of the tests, the most certain finding first."""
    verdict = "identifiable" if found.identifiable else "not identifiable"
    lines = [*_structure(found), _thesis_test(found), *_at_this_fit(found)]
    tables = Section("", [_start_table(found), _parameter_table(found)])
    return Report(
        subject="Identifiability",
        title=f"{found.circuit} is {verdict} from {found.trace}, {found.rmse_degC:.2f} degC off (RMSE)",
        lead=[],
        sections=[tables, Section("Findings", list(map(Finding, lines)))],
        data=as_json(found),
    )


def _thesis_test(found: Identifiability) -> str:
    """The test of the thesis; a structure that is identifiable may still not be so where the fit lies."""
    others, close = len(found.others), sum(each.another(CLOSE_PERCENT) for each in found.reestimates)
    more = f" {close - others} more came to {CLOSE_PERCENT:g} % or more." if close > others else ""
    moved = {name for each in found.others for name, share in each.moved.items() if share > MOVED}
    if not moved:
        verdict = "not shown to be unidentifiable."
    elif found.identifiable and moved <= set(found.sensitivity.mixed_here):
        verdict = f"not identifiable at this fit, where {', '.join(sorted(moved))} moved together and nothing else did."
    else:
        verdict = "not identifiable."
    ended = f"of {len(found.reestimates)} starts {others} ended at another parameter set"
    return f"The thesis's test: {ended} (one off by more than {100 * MOVED:g} %) with the same output: {verdict}{more}"


def _at_this_fit(found: Identifiability) -> Iterator[str]:
    known = found.sensitivity
    if known.blind_directions_here:
        mixed = f"{known.blind_directions_here} more, which mix {', '.join(known.mixed_here)}"
        yield f"At this fit the output does not change along {mixed}."
    if known.insensitive:
        little = f"(less than {INSENSITIVE_DEGC:g} degC per e-fold), not counted there: {', '.join(known.insensitive)}"
        yield f"Without effect at this fit {little}."
    if found.flat:
        errors = f"{found.rmse_degC:.2f} degC and an autocorrelation time of {found.correlation_samples:.0f} samples"
        yield f"Flat profiles: with errors of {errors}, this trace leaves a side open for {', '.join(found.flat)}."
    if found.recovered:
        far = [each.name for each in found.recovered if abs(each.standard_errors_off) > 2]
        near = f"{len(found.recovered) - len(far)} of {len(found.recovered)} identifiable parameters"
        but = f"; not so {', '.join(far)}" if far else ""
        yield f"Recovery: from its own noisy output the mean of {near} comes back within two standard errors{but}."


def _structure(found: Identifiability) -> Iterator[str]:
    known = found.sensitivity
    if found.identifiable:
        yield "Structure: identifiable; perfect data determine every free parameter."
        return
    count = f"{known.blind_directions} direction{'s' * (known.blind_directions > 1)}"
    yield f"Structure: not identifiable. The output does not change along {count}:"
    for up, down in map(_powers, known.symmetries):
        yield f"  {', '.join(up)} times k" + (f", {', '.join(down)} divided by k" if down else "")
    if (bent := known.blind_directions - len(known.symmetries)) > 0:
        yield f"  {bent} that depend on the values of {', '.join(known.mixed)}"
    products = ", ".join(map(_product, known.products))
    yield f"  Of the parameters that these mix, only products are identifiable: {products or 'none'}."


def _start_table(found: Identifiability) -> Table:
    rows = []
    for index, each in enumerate(found.reestimates):
        farthest = max(each.moved, key=lambda name: each.moved[name], default="")
        share = each.moved.get(farthest, 0.0)
        times = f"{share + 1:.3g}-fold" if share >= 1 else f"{100 * share:.2g} %"
        off = f"{farthest}, {times}" if farthest else "-"
        rows.append((f"{index + 1}", "yes" if each.another() else "no", f"{each.fit_percent:.2f} %", off))
    caption = f"{found.circuit} fitted to its own output over {found.trace}; what moved farthest from the truth."
    return Table(caption, ("start", "another set", "fit", "farthest off"), tuple(rows), labels=2)


def _parameter_table(found: Identifiability) -> Table:
    recovered = {each.name: each for each in found.recovered}
    rows = []
    for each in found.profiles:
        figures = f"{each.value:.4g}", f"{found.sensitivity.effect_degC[each.name]:.2g}"
        interval = " to ".join("open" if end is None else f"{end:.4g}" for end in each.interval95)
        back = recovered.get(each.name)
        comes_back = "-" if back is None else f"{back.mean:.4g} ({back.standard_errors_off:+.1f})"
        rows.append((each.name, _note(found, each.name), *figures, interval, comes_back))
    caption = (
        "Effect: change of the output in degC (RMS) per e-fold. Interval: 95 % by profile likelihood, open where flat. "
        "Comes back: mean from its own noisy output, and how many of its standard errors it is off."
    )
    return Table(caption, ("parameter", "", "value", "effect", "95 % interval", "comes back"), tuple(rows), labels=2)


def as_json(found: Identifiability) -> dict[str, Any]:
    """The content of ``identifiability --json``; what is open or not finite is null."""
    ends = [(each, each.another()) for each in found.reestimates]
    starts = [{"fit_percent": each.fit_percent, "another": so, "values": each.values} for each, so in ends]
    return {
        **{name: getattr(found, name) for name in _AS_THEY_ARE},
        "without_effect": found.sensitivity.insensitive,
        "values": {name: found.values[name] for name in found.sensitivity.effect_degC},
        "residual_memory_samples": found.correlation_samples,
        **asdict(found.sensitivity),
        "thesis_test": {
            "same_percent": SAME_PERCENT,
            "other_parameter_sets": len(found.others),
            "close_percent": CLOSE_PERCENT,
            "close_parameter_sets": sum(each.another(CLOSE_PERCENT) for each in found.reestimates),
            "starts": starts,
        },
        "profiles": [{**asdict(each), "flat": each.flat} for each in found.profiles],
        "recovered": [asdict(each) for each in found.recovered],
    }


def _note(found: Identifiability, name: str) -> str:
    notes = (
        ("in products", name in found.sensitivity.mixed),
        ("at its bound", name in found.at_bound),
        ("in products here", name in found.sensitivity.mixed_here),
        ("no effect here", name in found.sensitivity.insensitive),
        ("flat", name in found.flat),
    )
    return ", ".join(text for text, so in notes if so)


def _product(exponents: Mapping[str, float]) -> str:
    up, down = _powers(exponents)
    up, down = (up, down) if up else (down, up)
    return "·".join(up) + "".join(f"/{each}" for each in down)


def _powers(exponents: Mapping[str, float]) -> tuple[list[str], list[str]]:
    """The parameters with exponents above 0, and those with exponents below."""
    shown = {name: name if abs(power) == 1 else f"{name}^{abs(power):.3g}" for name, power in exponents.items()}
    up = [shown[name] for name in shown if exponents[name] > 0]
    return up, [shown[name] for name in shown if exponents[name] < 0]
