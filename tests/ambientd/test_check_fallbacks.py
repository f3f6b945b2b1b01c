"""``check`` proves what a model file says of its fallbacks, too, and tells where it does not hold."""

from ambient_model.codec import encode


def test_sound_fallbacks_are_told_of(ambientd, fallback_model_file):
    done = ambientd("check", "--model", fallback_model_file)
    assert done.returncode == 0
    assert "             passed: 2 fallbacks keep their equilibrium, and their periods agree\n" in done.stdout


def test_a_fallback_that_contradicts_itself_is_told_of_and_not_refused(ambientd, make_model, tmp_path):
    model = make_model(fallbacks=True)
    sound = model.fallbacks["battery"]
    wrong = sound.discrete[1]._replace(B=((sound.discrete[1].B[0][0] + 1e-3,),))
    damaged = sound._replace(discrete=(sound.discrete[0], wrong, *sound.discrete[2:]))
    path = tmp_path / "model.json"
    path.write_text(encode(model._replace(fallbacks={**model.fallbacks, "battery": damaged})))
    done = ambientd("check", "--model", path)
    assert (done.returncode, done.stderr) == (0, "")
    # most where usb goes from 25 to 26 degC: 1e-3 * 26 beside the 25.00995 degC that a right step of 0.2 s reaches
    [warning] = [each for each in done.stdout.splitlines() if each.startswith("warning")]
    assert "battery" in warning
    assert "0.00103959" in warning
    assert "keep their equilibrium" not in done.stdout
