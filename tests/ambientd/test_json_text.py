"""What is written without ``json`` is what ``json`` writes."""

import json

from hypothesis import given
from hypothesis import strategies as st

from ambientd.json_text import json_text

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.lists(inner).map(tuple) | st.dictionaries(st.text(), inner),
)


@given(VALUES)
def test_it_is_what_json_writes(value):
    assert json_text(value) == json.dumps(value)
