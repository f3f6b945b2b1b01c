"""An attribute's bytes are a number in degC, A or V, or nothing; whatever they are."""

import re
from fractions import Fraction

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ambientd.sources.quantities import degC_from_millidegrees, degC_from_tenths, from_micro

READERS = {degC_from_millidegrees: 1000, degC_from_tenths: 10, from_micro: 10**6}
every_reader = pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)

FORMS = [*b" ,\n,-,--1,nan,1e3,26.5,0x1F,1_000,+5,12 13,25000\n26000\n".split(b","), b"9" * 32, "٣٤".encode()]
ENDS = st.sampled_from([b"", b"\n", b" \n"])
NUMBERS = st.builds(lambda number, end: b"%d" % number + end, st.integers(-2732, 10**9), ENDS)
LONG = st.from_regex(rb"\s*-?[0-9]{1,40}\s*", fullmatch=True)


@every_reader
@example(content=b"-273150\n")
@example(content=b"-273151\n")
@example(content=b"-2731\n")
@given(content=st.binary(max_size=48) | st.sampled_from(FORMS) | NUMBERS | LONG)
def test_any_bytes_are_a_number_in_its_unit_or_missing(reader, content):
    value = reader(content)
    if len(content) >= 32 or not re.fullmatch(rb"\s*-?[0-9]+\s*", content):
        assert value is None
    elif value is None:
        assert reader is not from_micro
        assert int(content) / READERS[reader] < -273.15
    else:
        assert value >= -273.15 or reader is from_micro
        assert abs(Fraction(value) - Fraction(int(content), READERS[reader])) <= Fraction(abs(int(content)), 10**15)
