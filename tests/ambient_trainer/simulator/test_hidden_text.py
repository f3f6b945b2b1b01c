"""What the command line says of an effect: read, written, read again; whatever cannot be is refused, never a crash."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.simulator.hidden import Hidden, effects
from ambient_trainer.simulator.text import draw_hidden, hidden_text, parse_hidden
from refusals import refused, refused_places

_CAUSES = tuple(effects())
_LASTS_S = 23_100.0


def _read(text, seed=0):
    return parse_hidden([text], seed, _LASTS_S)[0]


@pytest.mark.parametrize(
    ("text", "effect"),
    [
        (
            "heat_source:board2:0.8W:from=7200:to=10800:signal=radio_on",
            Hidden("heat_source", "board2", "radio_on", 7200.0, 10800.0, 0.8),
        ),
        ("heat_source:board2:800mW:from=2h:to=180min", Hidden("heat_source", "board2", None, 7200.0, 10800.0, 0.8)),
        ("ambient_coupling:all:-40%:from=0:to=end", Hidden("ambient_coupling", None, None, 0.0, None, -0.4)),
        ("contact:back:.1W/K:from=1h:to=2h:body=pocket", Hidden("contact", "back", None, 3600, 7200, 0.1, "pocket")),
        ("path:usb-flash:0.1:from=9:to=end", Hidden("path", "usb-flash", None, 9.0, None, 0.1)),
        ("sensor_stuck:usb:held:from=1h:to=end", Hidden("sensor_stuck", "usb", None, 3600.0, None, None)),
        ("sensor_lag : display : 2min : from=1h : to=end", Hidden("sensor_lag", "display", None, 3600.0, None, 120.0)),
        ("clock_offset:-90s:from=0:to=end", Hidden("clock_offset", None, None, 0.0, None, -90.0)),
        ("thermal_mass:display:1.2e2J/K:from=0:to=end", Hidden("thermal_mass", "display", None, 0.0, None, 120.0)),
    ],
)
def test_a_text_means_what_it_says(text, effect):
    assert _read(text) == effect


@settings(max_examples=60)
@given(cause=st.sampled_from(_CAUSES), seed=st.integers(0, 2**32 - 1), scale=st.floats(0.0, 5.0))
def test_what_is_drawn_is_sound_and_reads_as_it_was_written(cause, seed, scale):
    drawn = draw_hidden(np.random.default_rng(seed), cause, _LASTS_S, scale)
    assert _read(hidden_text(drawn)) == drawn


_PIECES = st.one_of(
    st.sampled_from(
        [*_CAUSES, "random", "all", "usb", "board2", "flash-usb", "held", "0.8W", "-40%", "3", "1e9", "nan"]
    ),
    st.sampled_from(
        ["from=1h", "to=2h", "to=end", "from=-1", "signal=radio_on", "signal=none", "body=hand", "scale=2"]
    ),
    st.text(max_size=8),
)


@settings(max_examples=150)
@given(st.lists(_PIECES, max_size=6).map(":".join))
@example("")
@example("random:scale=1e400")
@example("sensor_bias:usb:1e999K")
@example("heat_source:usb:٣W")
def test_any_text_is_an_effect_or_refused(text):
    try:
        effect = _read(text)
    except Refused as error:
        refused = error
    else:
        assert effect.onset_s < _LASTS_S
        assert _read(hidden_text(effect)) == effect
        return
    assert refused.faults
    assert all(fault.place and fault.problem and fault.hint for fault in refused.faults)


def test_what_is_left_out_is_drawn_from_the_seed_and_for_each_effect_apart():
    assert _read("random", 1) == _read("random", 1)
    assert {_read("random", seed).cause for seed in range(200)} == set(_CAUSES)
    drawn = [_read("ambient_coupling:display", seed) for seed in range(50)]
    assert {each.location for each in drawn} == {"display"}
    assert {each.signal for each in drawn} == {None, "fan_on", "wind_m_s"}
    assert len({each.size for each in drawn}) > 30
    first, second = parse_hidden(["random", "random"], 5, _LASTS_S)
    assert first == _read("random", 5)
    assert second != first


def test_a_size_or_times_without_a_signal_mean_none_and_a_scale_multiplies_what_is_drawn():
    for text in ("heat_source:usb:0.3W", "heat_source:usb:from=1h", "heat_source:usb:to=2h"):
        assert {_read(text, seed).signal for seed in range(20)} == {None}
    assert len({_read("heat_source:usb", seed).signal for seed in range(20)}) > 1
    one, two = _read("thermal_mass:display", 3), _read("thermal_mass:display:scale=2", 3)
    assert two.amount == pytest.approx(2 * one.amount, rel=0.01)


def test_every_fault_of_every_effect_is_told_and_times_in_the_wrong_order():
    texts = ["warmth:usb", "heat_source:moon:9kW:from=9h:sig=1", "sensor_bias:usb:2K:3K", "random:usb"]
    places = refused_places(parse_hidden, texts, 0, _LASTS_S)
    assert [place.rpartition(", ")[2] for place in places] == [
        *("cause", "size", "sig=1", "from", "location", "3K", "location")
    ]
    assert [text for text in texts if not any(repr(text) in place for place in places)] == []
    assert "3600 s does not come after 7200 s" in str(refused(_read, "sensor_bias:usb:1K:from=2h:to=1h"))
