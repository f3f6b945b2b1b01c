"""What an early step has chosen gives way to what does better beside later ones."""

from dataclasses import replace

from ambient_trainer.diagnosis.greybox.choice import Step
from ambient_trainer.diagnosis.greybox.mechanisms import coupling, heat
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.revision import revised
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.greybox.screening import screen
from ambient_trainer.diagnosis.greybox.stepwise import bare_fit
from ambient_trainer.diagnosis.greybox.trials import compared


def test_heat_by_a_current_becomes_heat_by_its_square(circuit, simulated, recorded, seed):
    """Without the wind in the loss either does about as well."""
    hidden = {"heat_W": lambda now, _: 0.8 * now["current_A"] ** 2}
    held = recorded(simulated(seed, **hidden, conductance_W_K=lambda now, _: 0.3 + 0.12 * now["wind_m_s"]))
    bare = bare_fit(GreyBox.of(circuit), held)
    drivers = ("current_A", "current_A^2")
    by_current = [each for each in heat.candidates(Scene(bare)) if type(each) is heat.Heat and each.key[2] in drivers]
    screened = screen(Scene(bare), lambda scene, columns: iter(by_current))
    trials = [replace(each, rmse_degC=1.0) for each in compared(bare, screened, lambda done, total: None)]
    plain = next(each for each in trials if each.mechanism.key[2] == "current_A")
    wind = next(each for each in coupling.candidates(Scene(plain.fitted)) if each.key[2] == "wind_m_s")
    fitted = fit(plain.fitted.model.with_mechanism(wind), held, prior=bare.prior).refitted()
    (step,), after = revised([Step(bare, plain, tuple(trials), 2)], fitted, 0)
    assert step.chosen.mechanism.key[2] == "current_A^2", seed
    assert [each.key[2] for each in after.model.mechanisms] == ["current_A^2", "wind_m_s"], seed
    assert after.held_out_rmse_degC < 0.5 * fitted.held_out_rmse_degC, seed
    assert revised([step], after, 0) is None, seed
