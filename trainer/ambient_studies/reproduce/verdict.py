"""What came out like the thesis and what did not, said in full sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ambient_studies.reproduce.names import SCENARIOS, method_name
from ambient_studies.reproduce.rows import Row, like_published, spearman

WANTED_SPEARMAN = 0.85
_FAR = 2.0


@dataclass(frozen=True)
class Verdict:
    """``headline`` sums up; each of ``shortfalls`` is something that is not like the thesis."""

    spearman: float | None
    spearman_causal: float | None
    """The same with every estimate causal."""
    within_factor_two: int
    compared: int
    headline: str
    shortfalls: tuple[str, ...]


def verdict(rows: Sequence[Row]) -> Verdict:
    """What ``rows`` say of the reproduction."""
    compared = like_published(rows)
    found = spearman(compared)
    causal = spearman([row for row in rows if row.published is not None and row.variant == "corrected"])
    near = [row for row in compared if row.ratio is not None and 1 / _FAR <= row.ratio <= _FAR]
    return Verdict(
        found,
        causal,
        len(near),
        len(compared),
        f"Over {len(compared)} pairs of model and scenario, published and simulated RMSE rank alike with a Spearman "
        f"correlation of {_shown(found)}; {len(near)} simulated figures lie within a factor of {_FAR:g} of the "
        "published ones.",
        (*_correlation(found, causal), *_winners(compared), *_strays(compared)),
    )


def _correlation(found: float | None, causal: float | None) -> list[str]:
    said = []
    if found is None or found < WANTED_SPEARMAN:
        said.append(f"The rank correlation of {_shown(found)} falls short of the wanted {WANTED_SPEARMAN}.")
    if causal is not None:
        said.append(
            f"With Model 1 state-space single input evaluated causally too, as a device must, it is {causal:.2f}: the "
            "published figures of that model have seen the reference (erratum 9)."
        )
    return said


def _winners(rows: Sequence[Row]) -> list[str]:
    said = []
    for scenario in SCENARIOS:
        here = [row for row in rows if row.scenario == scenario and row.published and row.reproduced]
        if not here:
            continue
        published = min(here, key=lambda row: row.published.rmse_degC if row.published else 0.0)
        reproduced = min(here, key=lambda row: row.reproduced.rmse_degC if row.reproduced else 0.0)
        if published.model != reproduced.model:
            said.append(
                f"Scenario {scenario}: the thesis's best is {method_name(published.model)}, the simulated phone's "
                f"{method_name(reproduced.model)}."
            )
    return said


def _strays(rows: Sequence[Row]) -> list[str]:
    """The pairs that are more than twofold off, farthest first."""
    far = [(row.ratio, row) for row in rows if row.ratio is not None and not 1 / _FAR <= row.ratio <= _FAR]
    far.sort(key=lambda each: -max(each[0], 1 / max(each[0], 1e-12)))
    said = [
        f"Scenario {row.scenario}, {method_name(row.model)}: RMSE {row.reproduced.rmse_degC:.2f} degC simulated, "
        f"{row.published.rmse_degC:.2f} published."
        for _, row in far
        if row.reproduced and row.published
    ]
    lost = [row for row in rows if row.reproduced is None]
    return [*said, *(f"Scenario {row.scenario}, {method_name(row.model)}: no finite figure." for row in lost)]


def _shown(correlation: float | None) -> str:
    return "none" if correlation is None else f"{correlation:.2f}"
