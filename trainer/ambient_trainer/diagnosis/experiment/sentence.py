"""An experiment in words, so that it can be done without asking back: levels, spans, what to read, what to expect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from ambient_trainer.diagnosis.experiment.difference import Difference
from ambient_trainer.diagnosis.experiment.plan import ALWAYS, NEVER, Bench, Plan, Switch
from ambient_trainer.diagnosis.model import Effect
from ambient_trainer.diagnosis.words import digits, unit_of, window


@dataclass(frozen=True)
class Wording:
    """What sentences on explanations have in common: what each claims, the bench, and the sensors' names.

    The first claim is to be distinguished from all others; ``repeated`` is the effect that is made to act again.
    """

    claims: tuple[str, ...]
    bench: Bench
    sensors: Sequence[str]
    repeated: Effect | None

    def distinguished(self, found: Difference) -> str:
        """What to do, what to read, what each claim predicts, and which it leaves open."""
        first, *others = self.claims
        distinguished = [first, *(others[each] for each in found.others)]
        *before, last = (f"{each:.2f} degC if {said}" for each, said in zip(found.predicted_degC, distinguished))
        open_still = [said for each, said in enumerate(others) if each not in found.others]
        more = f" It does not separate whether {' or '.join([first, *open_still])}." if open_still else ""
        return (
            f"{self._done(found)}: {_when(found)} {self._look(found)} reads {', '.join(before)}, and {last}"
            f" (3 sigma is {digits(found.three_sigma_degC, 2)} degC).{more}"
        )

    def not_distinguished(self, found: Difference, longest_s: float) -> str:
        """That no plan distinguishes the first from any other, and how far the best plan comes."""
        differ_degC = abs(found.predicted_degC[0] - found.predicted_degC[1])
        all_of_them, any_two = ("both", "the two") if len(self.claims) == 2 else ("all", "the first and another")
        none = (
            f"No experiment of up to {span(longest_s)} that was simulated separates whether {' or '.join(self.claims)}"
        )
        if differ_degC < _SAME_DEGC:
            return f"{none}: {all_of_them} predict the same readings throughout."
        done = self._done(found)
        return (
            f"{none}. The most that {any_two} differ by is about {digits(differ_degC, 2)} degC on {self._look(found)}"
            f" (3 sigma is {digits(found.three_sigma_degC, 2)} degC), {_when(found)}: {_lower(done)}."
        )

    def _look(self, found: Difference) -> str:
        beside = " less a second thermometer at its place" if found.beside else ""
        return f"`{self.sensors[found.sensor]}`{beside}"

    def _done(self, found: Difference) -> str:
        """What is done until the reading: what is undone beforehand, rest, and every switch."""
        plan, begun = found.plan, rest(self.bench)
        when = "" if self.repeated is None else window(self.repeated.onset_s, self.repeated.end_s)
        if plan.undone:
            begun = f"Undo what happened {when} and {_lower(begun)}"
        if plan.again_s == ALWAYS:
            begun = f"Wait until it is as it was {when} and {_lower(begun)}"
        if found.reading_s is None:
            return begun
        steps = [(each.at_s, _switched(each, plan, self.bench)) for each in plan.switches]
        if plan.again_s is not None and 0.0 <= plan.again_s < NEVER:
            steps.append((plan.again_s, f"do again, on purpose, what happened {when}"))
        # what comes after the reading need not be done
        steps = sorted(
            (each for each in steps if each[0] == 0.0 or each[0] < found.reading_s), key=lambda each: each[0]
        )
        words = [f", then {text}" for _, text in steps[:1]]
        for (before_s, _), (at_s, text) in pairwise(steps):
            words.append(f" and {text}" if at_s == before_s else f" and {span(at_s - before_s)} later {text}")
        return begun + "".join(words)


_SAME_DEGC = 1e-3


def _when(found: Difference) -> str:
    if found.reading_s is None:
        return "then"
    if found.reading_s < 0:
        return f"{span(-found.reading_s)} before the reference shows it"
    return f"after {span(found.reading_s)}" if found.reading_s > 0 else "at once"


def rest(bench: Bench) -> str:
    """How every experiment begins."""
    levels = [f"`{name}` at {_level(name, value)}" for name, value in bench.rest.items()]
    return f"Hold {listed(levels)} until all readings stand still"


def _switched(switch: Switch, plan: Plan, bench: Bench) -> str:
    earlier = [each for each in plan.switches if each.column == switch.column and each.at_s < switch.at_s]
    level = earlier[-1].level if earlier else bench.rest[switch.column]
    if earlier and switch.level == bench.rest[switch.column]:
        return f"take `{switch.column}` back to {_level(switch.column, switch.level)}"
    return switching(switch.column, level, switch.level)


def switching(column: str, before: float, after: float) -> str:
    """One switch."""
    return f"take `{column}` from {before:.6g} to {_level(column, after)}"


def _level(column: str, value: float) -> str:
    return f"{value:.6g} {unit_of(column)}".rstrip()


def span(span_s: float) -> str:
    """A span to the second, in the units that it takes: ``1 h 25 min``."""
    whole = round(span_s)
    parts = [(whole // 3600, "h"), (whole // 60 % 60, "min"), (whole % 60, "s")]
    return " ".join(f"{count} {unit}" for count, unit in parts if count) or "0 s"


def listed(parts: Sequence[str]) -> str:
    """``a, b and c``."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _lower(text: str) -> str:
    return text[0].lower() + text[1:]
