"""One case of the discovery benchmark: what was hidden, what was found, and how well."""

from dataclasses import dataclass

from ambient_trainer.diagnosis import NONE, UNKNOWN, Cause


@dataclass(frozen=True)
class Outcome:
    """``true`` and ``found`` are empty where nothing was hidden or found; ``size_in_noise`` is the effect's RMSE in
    units of the residual's standard deviation without it (of two effects, the smaller one's).

    ``correct`` says whether cause, location and signal were named: of one effect by the first step, of several by some
    step each, and spare steps do not count; where nothing was hidden, whether there is no step. The errors are of the
    first effect, None where it has no magnitude or onset or was not found; ``gain_ci`` is the first step's, in degC.
    ``confidence`` is that of each cause in ``found``.
    """

    true: tuple[Cause, ...]
    size_in_noise: float
    found: tuple[Cause, ...]
    correct: bool
    magnitude_error_frac: float | None
    onset_error_s: float | None
    gain_ci: tuple[float, float] | None
    seconds: float
    confidence: tuple[float, ...] = ()

    @property
    def named(self) -> tuple[tuple[Cause, float, bool], ...]:
        """Each cause that was named, its confidence, and whether it was hidden."""
        pairs = zip(self.found, self.confidence)
        return tuple((cause, sure, cause in self.true) for cause, sure in pairs if cause.name not in (NONE, UNKNOWN))
