import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.data.probe_offsets import ProbeOffset, load_offsets

FILE = """\
format: probe-offsets
version: 1
created: 2026-05-01T10:00:00+00:00
reference: GMH thermometer
probes:
  air1:
    points:
    - {reading_degC: 0.1, offset_K: -0.1, standard_error_K: 0.002}
    - {reading_degC: 39.7, offset_K: 0.3, standard_error_K: 0.003}
  air2:
    points: [{reading_degC: 20.0, offset_K: 0.05, standard_error_K: 0.001}]
"""


def test_a_file_gives_each_probes_offset(tmp_path):
    path = tmp_path / "offsets.yaml"
    path.write_text(FILE)
    offsets = load_offsets(str(path))
    assert {name: len(offset.points) for name, offset in offsets.items()} == {"air1": 2, "air2": 1}
    assert offsets["air1"].at(19.9) == pytest.approx(0.1)
    assert offsets["air2"].at(-40.0) == 0.05
    assert str(offsets["air2"]) == "+0.050 K at 20 degC"


@given(
    points=st.dictionaries(st.integers(-50, 150), st.floats(-2.0, 2.0), min_size=1, max_size=6),
    reading_degC=st.floats(-60.0, 200.0),
)
def test_between_the_points_it_is_interpolated_and_beyond_them_the_nearest_holds(points, reading_degC):
    data = [{"reading_degC": at, "offset_K": points[at], "standard_error_K": 0.0} for at in sorted(points)]
    offset_K = ProbeOffset.model_validate({"points": data}).at(reading_degC)
    below = [at for at in points if at <= reading_degC]
    above = [at for at in points if at >= reading_degC]
    near = [points[at] for at in ([max(below)] if below else []) + ([min(above)] if above else [])]
    assert min(near) - 1e-9 <= offset_K <= max(near) + 1e-9
    if below and above and max(below) < min(above):
        share = (reading_degC - max(below)) / (min(above) - max(below))
        assert offset_K == pytest.approx((1 - share) * near[0] + share * near[1], abs=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "parts"),
    [
        ("version: 1", "version: 2", ["version 2", "version 1"]),
        ("version: 1\n", "", ["version", "missing"]),
        ("reading_degC: 39.7", "reading_degC: 0.1", ["probes.air1.points", "increase"]),
        ("offset_K: 0.05", "offset_K: .nan", ["probes.air2.points[0].offset_K", "nan"]),
        ("standard_error_K: 0.001", "sigma: 1", ["probes.air2.points[0].sigma", "unknown key"]),
        ("probes:", "probe:", ["probe", "unknown key"]),
        (FILE, "", ["None"]),
        (FILE, "- a\n", ["['a']"]),
        ("2026-05-01T10:00:00+00:00", "yesterday", ["created", "'yesterday'"]),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, before, after, parts):
    path = tmp_path / "offsets.yaml"
    path.write_text(FILE.replace(before, after))
    with pytest.raises(Refused) as caught:
        load_offsets(str(path))
    assert all(part in str(caught.value) for part in [str(path), *parts])
