"""The benchmark's figures as the terminal, the page and a machine get them: the same numbers, put once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.text import Text

from ambient_studies.discovery.figures import (
    LARGE_IN_NOISE,
    Share,
    by_cause,
    confusion,
    correct_of,
    detection_by_size,
    false_alarms,
    large_effects,
    median_of,
    pairs_found,
)
from ambient_studies.discovery.outcome import Outcome
from ambient_trainer.diagnosis.words import digits, duration
from ambient_trainer.report.table import Table, for_terminal


def headline(outcomes: Sequence[Outcome]) -> str:
    """What the benchmark shows, in one sentence each of what was hidden."""
    large, alarms, both = large_effects(outcomes), false_alarms(outcomes), pairs_found(outcomes).both
    said = [f"{len(outcomes):,} cases, drawn from seeds."]
    if large.cases:
        said.append(
            f"Of effects of at least {LARGE_IN_NOISE:g} times the noise, cause, place and signal are right in {large}."
        )
    if alarms.cases:
        said.append(f"Where nothing is hidden, something is found in {alarms}.")
    if both.cases:
        said.append(f"Of two effects at once, both are named in {both}.")
    return " ".join(said)


def causes_table(outcomes: Sequence[Outcome]) -> Table:
    """One row a cause."""
    rows = []
    for name, cases in by_cause(outcomes).items():
        large = [each for each in cases if each.size_in_noise >= LARGE_IN_NOISE]
        right = [each for each in large if each.correct]
        sizes = median_of(each.magnitude_error_frac for each in right)
        onsets = median_of(each.onset_error_s for each in right)
        rows.append(
            (
                name,
                str(len(cases)),
                str(correct_of(large)),
                _percent(sizes),
                duration(onsets) if math.isfinite(onsets) else "-",
                _gains(right),
            )
        )
    caption = (
        f"Large: at least {LARGE_IN_NOISE:g} times the residual's standard deviation. Right: cause, place and signal; "
        "in brackets the 95 % interval. Errors: the median, of the right ones. Gain: in how many of them its interval "
        "on held-out data lies above zero."
    )
    columns = ("hidden", "cases", "large ones right", "error of size", "of onset", "gain above zero")
    return Table(caption, columns, tuple(rows))


def totals_table(outcomes: Sequence[Outcome]) -> Table:
    """The figures over all causes, one a row."""
    pairs = pairs_found(outcomes)
    rows = [
        (
            f"one effect of at least {LARGE_IN_NOISE:g} times the noise: cause, place and signal right",
            large_effects(outcomes),
        ),
        ("nothing hidden: something found (false alarm)", false_alarms(outcomes)),
        ("two effects at once: both named", pairs.both),
        ("two effects at once: at least one named", pairs.one),
        ("two effects at once: nothing found", pairs.nothing),
    ]
    return Table("", ("hidden and found", "share (95 %)"), tuple((what, str(share)) for what, share in rows))


def confusion_table(outcomes: Sequence[Outcome]) -> Table:
    """What each cause was taken for, one row each: a column for each would not fit a terminal."""
    matrix = confusion(outcomes)
    rows = []
    for name, counts in zip(matrix.true, matrix.counts.tolist()):
        wrong = sorted(((count, other) for other, count in zip(matrix.found, counts) if other != name and count))[::-1]
        right = dict(zip(matrix.found, counts))[name]
        taken = ", ".join(f"{other} {count}" for count, other in wrong) or "-"
        rows.append((name, taken, str(sum(counts)), str(right)))
    return Table(
        "By the first cause found; its place not counted.", ("hidden", "taken for", "cases", "right"), tuple(rows), 2
    )


def show(console: Console, outcomes: Sequence[Outcome]) -> None:
    """The terminal's view."""
    console.print(Text(headline(outcomes), style="bold"), soft_wrap=True)
    console.print(for_terminal(totals_table(outcomes)))
    console.print(for_terminal(causes_table(outcomes)))
    console.print(for_terminal(confusion_table(outcomes)))


def as_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The figures for a machine; a share without cases is null."""
    matrix, pairs = confusion(outcomes), pairs_found(outcomes)
    return {
        "cases": len(outcomes),
        "large_effects": _share_data(large_effects(outcomes)),
        "false_alarms": _share_data(false_alarms(outcomes)),
        "two_at_once": {
            "both": _share_data(pairs.both),
            "at_least_one": _share_data(pairs.one),
            "nothing": _share_data(pairs.nothing),
        },
        "by_size": [
            {
                "from": each.low,
                "to": each.high if math.isfinite(each.high) else None,
                "median": each.middle,
                **_share_data(each.share),
            }
            for each in detection_by_size(outcomes)
        ],
        "by_cause": {
            name: _share_data(correct_of(cases)) for name, cases in by_cause(outcomes, LARGE_IN_NOISE).items()
        },
        "confusion": {"true": list(matrix.true), "found": list(matrix.found), "counts": matrix.counts.tolist()},
    }


def _gains(outcomes: Sequence[Outcome]) -> str:
    known = [each.gain_ci for each in outcomes if each.gain_ci is not None]
    return f"{sum(low > 0 for low, _ in known)} of {len(known)}" if known else "-"


def _percent(part: float) -> str:
    return f"{digits(100 * part, 2)} %" if math.isfinite(part) else "-"


def _share_data(share: Share) -> dict[str, Any]:
    if not share.cases:
        return {"share": None, "ci95": None, "hits": 0, "cases": 0}
    return {"share": share.value, "ci95": list(share.ci95), "hits": share.hits, "cases": share.cases}
