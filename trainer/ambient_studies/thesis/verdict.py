"""What of a reproduction agrees with the thesis, and what does not, in sentences."""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

from ambient_studies.thesis.names import SCENARIOS, method_name
from ambient_studies.thesis.rows import Row, like_published, spearman

WANTED_SPEARMAN = 0.85
"""The bar of the calibration of the simulated phone; chosen."""
_FAR = 2.0


@dataclass(frozen=True)
class Verdict:
    """``headline`` sums up; each of ``shortfalls`` is a difference from the thesis."""

    spearman: float | None
    spearman_causal: float | None
    """The same with every estimate causal."""
    compared: int
    within_factor_two: int
    headline: str
    shortfalls: tuple[str, ...]


def verdict(rows: Sequence[Row]) -> Verdict:
    """Compare the rows with the thesis's."""
    compared = like_published(rows)
    correlation = spearman(compared)
    causal = spearman([row for row in rows if row.published is not None and row.variant == "corrected"])
    near = sum(row.ratio is not None and 1 / _FAR <= row.ratio <= _FAR for row in compared)
    headline = (
        f"Over {len(compared)} pairs of model and scenario, published and simulated RMSE rank alike with a Spearman "
        f"correlation of {_shown(correlation)}; {near} simulated figures lie within a factor of {_FAR:g} of the "
        "published ones."
    )
    shortfalls = (*_correlations(correlation, causal), *_winners(compared), *_strays(compared))
    return Verdict(correlation, causal, len(compared), near, headline, shortfalls)


def _correlations(correlation: float | None, causal: float | None) -> list[str]:
    lines = []
    if correlation is None or correlation < WANTED_SPEARMAN:
        lines.append(f"The rank correlation of {_shown(correlation)} falls short of the wanted {WANTED_SPEARMAN}.")
    if causal is not None:
        lines.append(
            f"With Model 1 state-space single input evaluated causally too, as a device must, it is {causal:.2f}: the "
            "published figures of that model have seen the reference (erratum 9)."
        )
    return lines


def _winners(rows: Sequence[Row]) -> list[str]:
    lines = []
    for scenario in SCENARIOS:
        here = [(row.published, row.reproduced, row.model) for row in rows if row.scenario == scenario]
        known = [(one.rmse_degC, other.rmse_degC, model) for one, other, model in here if one and other]
        if known:
            published, simulated = (min(known, key=itemgetter(column))[2] for column in (0, 1))
            if published != simulated:
                lines.append(
                    f"Scenario {scenario}: the thesis's best is {method_name(published)}, the simulated phone's "
                    f"{method_name(simulated)}."
                )
    return lines


def _strays(rows: Sequence[Row]) -> list[str]:
    """The pairs that differ by more than a factor of two, farthest first."""
    far = [(row.ratio, row) for row in rows if row.ratio is not None and not 1 / _FAR <= row.ratio <= _FAR]
    far.sort(key=lambda each: -max(each[0], 1 / max(each[0], 1e-12)))
    lines = [
        f"Scenario {row.scenario}, {method_name(row.model)}: RMSE {row.reproduced.rmse_degC:.2f} degC simulated, "
        f"{row.published.rmse_degC:.2f} published."
        for _, row in far
        if row.reproduced and row.published
    ]
    lost = [row for row in rows if row.reproduced is None]
    return [*lines, *(f"Scenario {row.scenario}, {method_name(row.model)}: no finite figure." for row in lost)]


def _shown(correlation: float | None) -> str:
    return "none" if correlation is None else f"{correlation:.2f}"
