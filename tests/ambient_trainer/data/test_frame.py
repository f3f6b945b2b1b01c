"""A DataFrame is a trace as a file is: what comes back is the same, what is no trace is refused by row and column."""

import numpy as np
import pandas as pd
import pytest

from ambient_model.faults import Refused
from ambient_trainer.data.trace import Trace, load_trace

TRACE = Trace("a.csv", np.array([0.0, 1.5, 3.0]), {"usb_degC": np.array([20.0, np.nan, 21.0])}, {"room": "office"})


@pytest.mark.parametrize(
    "frame",
    [
        TRACE.to_frame(),
        TRACE.to_frame().reset_index(),
        TRACE.to_frame().set_axis(pd.to_timedelta(TRACE.time_s, "s")),
        TRACE.to_frame().set_axis(pd.to_datetime(TRACE.time_s, unit="s", utc=True)),
        TRACE.to_frame().astype("Float64"),
    ],
)
def test_a_frame_is_the_trace_it_came_from(frame):
    found = load_trace(frame)
    assert found.time_s.tolist() == TRACE.time_s.tolist()
    np.testing.assert_array_equal(found.columns["usb_degC"], TRACE.columns["usb_degC"])
    assert (list(found.columns), found.notes) == (["usb_degC"], TRACE.notes)


def test_a_trace_owns_its_arrays():
    frame = TRACE.to_frame()
    load_trace(frame).columns["usb_degC"][0] = 99.0
    assert frame["usb_degC"].iloc[0] == 20.0


@pytest.mark.parametrize(
    ("columns", "index", "named"),
    [
        ({"usb": [1.0, 2.0]}, [0, 1], ["'usb'", "usb_degC"]),
        ({"usb_degC": [1.0, 2.0]}, [1, 1], ["row 1", "time_s"]),
        ({"usb_degC": [1.0, 2.0]}, [0.0, np.nan], ["row 1", "time_s"]),
        ({"usb_degC": [1.0, np.inf]}, [0, 1], ["row 1", "usb_degC"]),
        ({"usb_degC": [1.0, 1e37]}, [0, 1], ["row 1", "1e+37"]),
        ({"usb_degC": ["warm", "cold"]}, [0, 1], ["usb_degC", "warm"]),
        ({"usb_degC": []}, [], ["no rows"]),
    ],
)
def test_what_is_no_trace_is_refused_by_place(columns, index, named):
    with pytest.raises(Refused) as refused:
        load_trace(pd.DataFrame(columns, index=index))
    assert all(each in str(refused.value) for each in ["DataFrame", *named])


def test_a_column_that_stands_twice_is_refused():
    with pytest.raises(Refused, match="usb_degC"):
        load_trace(pd.DataFrame([[1.0, 2.0]], columns=["usb_degC", "usb_degC"]))
