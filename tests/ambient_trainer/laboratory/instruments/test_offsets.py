from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.laboratory.instruments.offsets import ProbeOffset, load_offsets

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


def test_a_file_gives_each_probes_offset(tmp_path) -> None:
    path = tmp_path / "offsets.yaml"
    path.write_text(FILE)
    offsets = load_offsets(str(path))
    assert offsets == {
        "air1": ProbeOffset(((0.1, -0.1), (39.7, 0.3))),
        "air2": ProbeOffset(((20.0, 0.05),)),
    }
    assert offsets["air1"].at(19.9) == pytest.approx(0.1)
    assert offsets["air2"].at(-40.0) == 0.05


@given(
    points=st.dictionaries(st.integers(-50, 150), st.floats(-2.0, 2.0), min_size=1, max_size=6),
    reading_degC=st.floats(-60.0, 200.0),
)
def test_between_the_points_it_goes_straight_and_beyond_them_the_nearest_holds(points, reading_degC) -> None:
    offset = ProbeOffset(tuple((float(at), offset_K) for at, offset_K in sorted(points.items())))
    known = np.array(offset.points)
    assert offset.at(reading_degC) == pytest.approx(np.interp(reading_degC, known[:, 0], known[:, 1]), abs=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "fault"),
    [
        ("version: 1", "version: 2", "format 'probe-offsets', version 2; 'calibrate' writes format 'probe-offsets', "),
        ("version: 1\n", "", "version: missing; add it"),
        ("reading_degC: 39.7", "reading_degC: 0.1", "probes.air1: the readings do not increase; sort the points"),
        ("offset_K: 0.05", "offset_K: .nan", "probes.air2.points[0].offset_K: nan: input should be a finite number"),
        ("standard_error_K: 0.001", "sigma: 1", "probes.air2.points[0].sigma: unknown key"),
        ("probes:", "probe:", "probe: unknown key"),
        (FILE, "", "None: input should be a valid dictionary"),
        (FILE, "- a\n", "['a']: input should be a valid dictionary"),
        ("2026-05-01T10:00:00+00:00", "yesterday", "created: 'yesterday': input should be a valid datetime"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, before, after, fault) -> None:
    path = tmp_path / "offsets.yaml"
    path.write_text(FILE.replace(before, after))
    with pytest.raises(Refused) as caught:
        load_offsets(str(path))
    assert fault in str(caught.value)
    assert str(path) in str(caught.value)
