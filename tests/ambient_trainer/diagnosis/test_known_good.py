"""Known-good records hold what they determine, and leave to the diagnosed ones what they do not."""

import numpy as np
import pytest

from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import Prior, fit
from ambient_trainer.diagnosis.record import records_of

PERIOD_S = 60.0


@pytest.fixture(scope="module")
def circuit(box_circuit):
    return box_circuit


@pytest.fixture(scope="module")
def box_circuit():
    from pathlib import Path

    return load_circuit(str(Path(__file__).parents[2] / "data" / "circuits" / "box.yaml"))


def test_a_prior_from_records_is_their_least_squares(circuit, boxed):
    """A fit to one record under the prior of another, where both leave the same, is that to both together."""
    one, other = (records_of(circuit, boxed("none", seed), PERIOD_S) for seed in (1, 2))
    model = GreyBox.of(circuit)
    first = fit(model, one, tolerance=1e-9)
    together = fit(model, [*one, *other], tolerance=1e-9)
    after = fit(first.model, other, prior=Prior.trained(first), tolerance=1e-9)
    scatter = np.sqrt(np.diag(together.covariance))
    assert (np.abs(after.model.z() - together.model.z()) < 2 * scatter + 0.01).all()


def test_what_changed_is_not_taken_up_by_what_is_known(circuit, boxed):
    """The lid is closed: beside a known-good run the loss has changed, and nothing else."""
    found = diagnose(circuit, [boxed("ambient_coupling", 1)], [boxed("none", 101)], period_s=PERIOD_S)
    assert (found.verdict_cause.name, found.verdict_cause.location) == ("ambient_coupling", "shell")
    assert found.verdict.magnitude.value == pytest.approx(0.25 / 0.15 - 1, rel=0.1)
    assert found.verdict.magnitude.ci95[0] > 0
