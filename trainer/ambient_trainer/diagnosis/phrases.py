"""What each cause is called: a noun for verdicts, and what it says of the device. A new cause has one row here."""

from __future__ import annotations

from typing import NamedTuple

from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Cause


class _Phrase(NamedTuple):
    effect: str
    claim: str
    """With ``{place}`` where its location stands."""


_PHRASES = {
    "heat_source": _Phrase("heat that the circuit does not know", "a source heats {place}"),
    "ambient_coupling": _Phrase(
        "a changed resistance to the ambient", "the resistance from {place} to the ambient changed"
    ),
    "contact": _Phrase("the contact with a body of its own temperature", "a body holds on at {place}"),
    "convection_law": _Phrase(
        "a loss that is not proportional to the difference to the ambient",
        "the loss from {place} is not proportional to the difference to the ambient",
    ),
    "thermal_mass": _Phrase("a thermal mass that the circuit lacks", "a body that the circuit lacks hangs on {place}"),
    "path": _Phrase("a conduction path that the circuit lacks", "heat is conducted between {place}"),
    "sensor_bias": _Phrase("a sensor that is off by a constant", "{place} reads with a bias"),
    "sensor_gain": _Phrase("a sensor with a wrong gain", "{place} reads with a wrong slope"),
    "sensor_lag": _Phrase("a sensor that lags", "{place} reads late"),
    "sensor_stuck": _Phrase("a sensor that is stuck", "{place} is stuck"),
    "sensor_drift": _Phrase("a sensor that drifts", "{place} drifts"),
    "clock_offset": _Phrase("a clock offset between the reference and the device", "the reference's clock is off"),
    UNKNOWN: _Phrase("a misfit that no known cause explains", "something that was not tried is missing"),
    NONE: _Phrase("nothing", "nothing is missing"),
}


def effect(cause: Cause) -> str:
    """``cause`` as a noun: ``heat that the circuit does not know, at flash, driven by camera_on``."""
    words = _PHRASES[cause.name].effect
    if cause.location is not None:
        words += f", {'between' if '-' in cause.location else 'at'} {cause.location.replace('-', ' and ')}"
    return words + ("" if cause.signal is None else f", driven by {cause.signal}")


def claim(cause: Cause) -> str:
    """What ``cause`` says of the device, as a clause."""
    place = "all nodes" if cause.location is None else " and ".join(f"`{each}`" for each in cause.location.split("-"))
    return _PHRASES[cause.name].claim.format(place=place) + ("" if cause.signal is None else f" with `{cause.signal}`")
