"""The report of the benchmark: what was named, what was taken for what, and how large an effect has to be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ambient_studies.discovery import figures
from ambient_studies.discovery.figures import CONFIDENT, LARGE_IN_NOISE, Outcome, Range, Share
from ambient_studies.discovery.runner import Done
from ambient_trainer.diagnosis import digits, duration
from ambient_trainer.report import Facts, Figure, Finding, Report, Section, Table, palette, plots

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]

_SENTENCES = {
    "large_effects": f"Of effects of at least {LARGE_IN_NOISE:g} times the noise, cause, place and signal are right in",
    "false_alarms": "Where nothing is hidden, something is found in",
    "both": "Of two effects at once, both are named in",
}
_ROWS = {
    "large_effects": f"one effect of at least {LARGE_IN_NOISE:g} times the noise: cause, place and signal right",
    "false_alarms": "nothing hidden: something found (false alarm)",
    "both": "two effects at once: both named",
    "at_least_one": "two effects at once: at least one named",
    "nothing": "two effects at once: nothing found",
}
_ASKED = {
    "large_effects": (f"large effects named ({LARGE_IN_NOISE:g} times the noise)", 0.92),
    "false_alarms": ("nothing found where nothing is", 0.95),
    "both": ("both of two effects named", 0.80),
    "confident_verdicts": (f"verdicts of confidence {CONFIDENT:g} or more right", CONFIDENT),
}
"""What the benchmark asks for, by the name of its share; of false alarms, that there are none."""
_CAUSES = (
    f"Large: at least {LARGE_IN_NOISE:g} times the residual's standard deviation. Right: cause, place and signal; in "
    "brackets the 95 % interval. Errors: the median, of the right ones. Gain: in how many of them its interval on "
    "held-out data lies above zero."
)
_CONFUSION = (
    "Cases with nothing or one effect hidden, of every size: what was hidden by row, the first cause named by column, "
    "in counts. Blue is right, orange wrong, deeper with the share of the row."
)
_RELIABILITY = (
    "Verdicts by their confidence: the mean confidence of each range, and the share whose cause, place and signal were "
    "hidden. On the diagonal confidence is a probability; below it, too much is claimed."
)
_DETECTION = (
    "Cases with one effect, by its size: what it adds to the sensors (RMSE) over the standard deviation of the "
    "residual without it."
)


def report_of(outcomes: Sequence[Outcome], data: Mapping[str, Any]) -> Report:
    """What the benchmark shows; ``data`` is what ``--json`` writes."""
    shares = figures.shares_of(outcomes)
    mix = [sum(len(each.true) == effects for each in outcomes) for effects in range(3)]
    seconds = [each.seconds for each in outcomes]
    totals = Table("", ("hidden and found", "share (95 %)"), [(what, str(shares[key])) for key, what in _ROWS.items()])
    confused = Figure(partial(_confusion_figure, outcomes), _CONFUSION) if outcomes else None
    detection = Figure(partial(_detection_figure, outcomes), _DETECTION) if figures.single_effects(outcomes) else None
    reliable: list[Figure | Table] = []
    if figures.reliability(outcomes):
        reliable = [Figure(partial(_reliability_figure, outcomes), _RELIABILITY), reliability_table(outcomes)]
    return Report(
        subject="Discovery benchmark, simulated",
        title=f"{len(outcomes):,} simulated cases: large effects right in {shares['large_effects']}",
        lead=[
            *(Finding(f"{text} {shares[key]}.", "result") for key, text in _SENTENCES.items() if shares[key].cases),
            Facts(
                [
                    ("cases", f"{mix[0]} with nothing hidden, {mix[1]} with one effect, {mix[2]} with two"),
                    ("median time", duration(float(np.median(seconds))) if seconds else "-"),
                    ("longest time", duration(max(seconds, default=0.0))),
                ]
            ),
        ],
        sections=[
            Section("Against what is asked", [*_asked(shares), totals]),
            Section("What is taken for what", [confused, confusion_table(outcomes)]),
            Section("How large an effect has to be", [detection]),
            Section("What confidence is worth", reliable),
            Section("Cause by cause", [causes_table(outcomes)]),
        ],
        data=data,
        footnotes=[
            "Each case is a run of a simulated device with an effect of its own physics, drawn from a seed that the "
            "diagnosis never sees. Intervals of shares are Wilson's, 95 %."
        ],
    )


def as_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The figures for a machine; a share without cases is null."""
    matrix = figures.confusion(outcomes)
    shares = {name: _share_data(each) for name, each in figures.shares_of(outcomes).items()}
    large = figures.by_cause(outcomes, LARGE_IN_NOISE)
    return {
        "cases": len(outcomes),
        **{name: shares[name] for name in ("large_effects", "false_alarms", "confident_verdicts")},
        "two_at_once": {name: shares[name] for name in ("both", "at_least_one", "nothing")},
        "by_size": [_range_data(each, "median") for each in figures.detection_by_size(outcomes)],
        "reliability": [_range_data(each, "mean_confidence") for each in figures.reliability(outcomes)],
        "by_cause": {name: _share_data(figures.correct_of(cases)) for name, cases in large.items()},
        "confusion": {"true": list(matrix.index), "found": list(matrix), "counts": matrix.to_numpy().tolist()},
    }


def case_json(done: Done) -> dict[str, Any]:
    """One case for a machine."""
    return {
        "number": done.case.number,
        "run_seed": done.case.seed,
        **asdict(done.outcome),
        "named": [{**asdict(cause), "confidence": sure, "right": right} for cause, sure, right in done.outcome.named],
        "rivals": list(done.rivals),
        "said": list(done.sentences),
    }


def causes_table(outcomes: Sequence[Outcome]) -> Table:
    """One row a cause."""
    columns = ("hidden", "cases", "large ones right", "error of size", "of onset", "gain above zero")
    large = figures.by_cause(outcomes, LARGE_IN_NOISE)
    rows = [(name, str(len(cases)), *_cause_cells(large[name])) for name, cases in figures.by_cause(outcomes).items()]
    return Table(_CAUSES, columns, rows)


def reliability_table(outcomes: Sequence[Outcome]) -> Table:
    """One row a range of confidence."""
    rows = [
        (f"{each.low:g} to {each.high:g}", f"{each.middle:.2f}", str(each.share))
        for each in figures.reliability(outcomes)
    ]
    return Table("First causes named, by confidence.", ("confidence", "mean", "right (95 %)"), rows)


def confusion_table(outcomes: Sequence[Outcome]) -> Table:
    """What each cause was taken for, one row each: a column for each would not fit a terminal."""
    rows = []
    for name, counts in figures.confusion(outcomes).to_dict("index").items():
        wrong = sorted(((count, other) for other, count in counts.items() if other != name and count), reverse=True)
        taken = ", ".join(f"{other} {count}" for count, other in wrong) or "-"
        rows.append((str(name), taken, str(sum(counts.values())), str(counts[name])))
    return Table("By the first cause named; its place not counted.", ("hidden", "taken for", "cases", "right"), rows, 2)


def _cause_cells(large: Sequence[Outcome]) -> Iterator[str]:
    right = [each for each in large if each.correct]
    size = figures.median_of(each.magnitude_error_frac for each in right)
    onset = figures.median_of(each.onset_error_s for each in right)
    gains = [each.gain_ci for each in right if each.gain_ci is not None]
    yield str(figures.correct_of(large))
    yield f"{digits(100 * size, 2)} %" if math.isfinite(size) else "-"
    yield duration(onset) if math.isfinite(onset) else "-"
    yield f"{sum(low > 0 for low, _ in gains)} of {len(gains)}" if gains else "-"


def _asked(shares: Mapping[str, Share]) -> Iterator[Finding]:
    """A tile for each bar that has cases: what is reached, and whether that is enough."""
    for key, (what, asked) in _ASKED.items():
        reached = 1 - shares[key].value if key == "false_alarms" else shares[key].value
        if math.isfinite(reached):
            text = f"{what}; asked: at least {100 * asked:.0f} %{'' if reached >= asked else ', not reached'}"
            yield Finding(text, "good" if reached >= asked else "bad", value=f"{100 * reached:.1f} %")


def _share_data(share: Share) -> dict[str, Any]:
    if not share.cases:
        return {"share": None, "ci95": None, "hits": 0, "cases": 0}
    return {"share": share.value, "ci95": list(share.ci95), "hits": share.hits, "cases": share.cases}


def _range_data(part: Range, middle: str) -> dict[str, Any]:
    high = part.high if math.isfinite(part.high) else None
    return {"from": part.low, "to": high, middle: part.middle, **_share_data(part.share)}


def _confusion_figure(outcomes: Sequence[Outcome]) -> go.Figure:
    matrix = figures.confusion(outcomes)
    true, found, counts = matrix.index.tolist(), matrix.columns.tolist(), matrix.to_numpy()
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    right = np.array(true)[:, None] == np.array(found)
    texts = [[str(count) if count else "" for count in row] for row in counts.tolist()]
    figure = plots.matrix_figure(found, true, np.where(right, shares, -shares).tolist(), texts, cell_px=34)
    figure.update_layout(height=figure.layout.height + 130)
    for update, names in ((figure.update_xaxes, found), (figure.update_yaxes, true)):
        # names in two lines, small: a phone's screen has room for the cells besides
        lines = [name.replace("_", "<br>") for name in names]
        update(tickvals=names, ticktext=lines, tickfont={"size": 11}, automargin=True)
    figure.update_xaxes(side="top", tickangle=-90)
    return figure


def _shares_figure(x_title: str, x: Sequence[float], found: Sequence[Range]) -> go.Figure:
    """The shares of the ranges ``found`` over ``x``, with their intervals."""
    shares = [100 * each.share.value for each in found]
    ends = [(100 * low, 100 * high) for low, high in (each.share.ci95 for each in found)]
    hover = [f"{each.share.hits} of {each.share.cases}" for each in found]
    figure = plots.panel_figure(x_title, "cause, place and signal right [%]", height_px=400)
    name = "right, with its 95 % interval"
    plots.add_curve(figure, x, shares, name, palette.ESTIMATE, width=2, ends=ends, hover=hover)
    figure.update_yaxes(range=[-3, 103])
    return figure


def _reliability_figure(outcomes: Sequence[Outcome]) -> go.Figure:
    found = figures.reliability(outcomes)
    figure = _shares_figure("confidence [%]", [100 * each.middle for each in found], found)
    plots.add_curve(figure, [0, 100], [0, 100], "as stated", palette.LIMIT, dash="dash", width=1.6)
    figure.update_xaxes(range=[-3, 103], hoverformat=".0f")
    return figure


def _detection_figure(outcomes: Sequence[Outcome]) -> go.Figure:
    found = figures.detection_by_size(outcomes)
    sizes = [each.middle for each in found]
    figure = _shares_figure("size, in units of the noise", sizes, found)
    asked = 100 * _ASKED["large_effects"][1]
    end = max(*sizes, 2 * LARGE_IN_NOISE)
    name = f"asked: {asked:.0f} % from {LARGE_IN_NOISE:g} on"
    plots.add_curve(figure, [LARGE_IN_NOISE, end], [asked, asked], name, palette.LIMIT, dash="dash", width=1.6)
    figure.update_xaxes(type="log", tickvals=[0.2, 0.5, 1, 2, 5, 10, 20, 50, 100], hoverformat=".1f")
    return figure
