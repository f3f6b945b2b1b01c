"""Mechanisms that a circuit may lack, one file each, found by place; each generates its candidates for a context.

How one begins follows from its numbers. Amounts are tried a small step from nothing and begin where a linear fit has
them; of a conductance, which is never nothing, a small share is tried, and it begins with another.
"""

from collections.abc import Sequence

import numpy as np

from ambient_trainer.diagnosis.greybox.model import Mechanism, Number


class InProportion(Mechanism):
    """Acts in proportion to each of its numbers but those that are logarithmic, which stay where they are."""

    step = 1.0
    """Of a number's scale: what is tried of it."""
    from_nothing = False
    """Whether it may begin with none of its amounts."""

    def probes(self) -> Sequence[Sequence[float]]:
        rest = [each.value if each.log else 0.0 for each in self.numbers]
        tried = [(at, self.step * each.scale) for at, each in enumerate(self.numbers) if not each.log]
        return [[*rest[:at], step, *rest[at + 1 :]] for at, step in tried]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        given = iter(amounts)
        values = [
            each.value if each.log else float(np.clip(self.step * next(given) * each.scale, *self.begins(each)))
            for each in self.numbers
        ]
        acts = any(value for value, each in zip(values, self.numbers) if not each.log)
        return self.with_values(values) if acts or self.from_nothing else None

    def begins(self, number: Number) -> tuple[float, float]:
        """Within which bounds one of its numbers begins."""
        return number.low, number.high


class Joined(Mechanism):
    """Joins something to a node, by a conductance that is its first number."""

    probe, least, most = 1e-3, 0.05, 3.0
    """The share of it that is tried, and those with which it begins."""

    def probes(self) -> Sequence[Sequence[float]]:
        return [self._with_share(self.probe)]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        return self.with_values(self._with_share(float(np.clip(self.probe * amounts[0], self.least, self.most))))

    def _with_share(self, share: float) -> Sequence[float]:
        first, *others = (each.value for each in self.numbers)
        return [share * first, *others]
