"""Diagnosis of a circuit's misfit to data: causes identified, added to the circuit, and scored on held-out data."""

from ambient_trainer.diagnosis.diagnose import diagnose, diagnose_changed, learn_known_good
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.known_good import KnownGood
from ambient_trainer.diagnosis.record import records_of
from ambient_trainer.diagnosis.report import report_of
from ambient_trainer.diagnosis.result import (
    NONE,
    UNKNOWN,
    Cause,
    Diagnosis,
    Gain,
    Magnitude,
    Misfit,
    Ranked,
    Step,
    Tested,
)
from ambient_trainer.report.words import digits, duration
