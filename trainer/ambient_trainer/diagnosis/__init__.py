"""What a circuit gets wrong about measured data: shown, named, added to the circuit, and scored on other data."""

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.report import report_of
from ambient_trainer.diagnosis.result import Cause, Diagnosis, Gain, Magnitude, Misfit, Ranked, Step, Tested

__all__ = [
    "Cause",
    "Diagnosis",
    "Gain",
    "Magnitude",
    "Misfit",
    "Ranked",
    "Step",
    "Tested",
    "diagnose",
    "report_of",
]
