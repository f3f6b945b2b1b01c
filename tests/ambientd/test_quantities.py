"""An attribute's bytes are a number in degC, A or V, or nothing; whatever they are."""

import math
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambientd.sources.quantities import degC_from_millidegrees, degC_from_tenths, from_micro

READERS = {degC_from_millidegrees: 1000, degC_from_tenths: 10, from_micro: 10**6}
every_reader = pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)
quick = settings(derandomize=True, deadline=None)


@every_reader
@quick
@given(number=st.integers(-2731, 10**9), end=st.sampled_from([b"", b"\n", b" \n"]))
def test_steps_become_units(reader, number, end):
    value = reader(str(number).encode() + end)
    assert value is not None
    assert abs(Fraction(value) - Fraction(number, READERS[reader])) < Fraction(1, 10**6)


@every_reader
@quick
@given(content=st.binary(max_size=48) | st.from_regex(rb"\s*-?[0-9]{1,40}\s*", fullmatch=True))
def test_any_bytes_are_a_finite_number_or_missing(reader, content):
    value = reader(content)
    assert value is None or math.isfinite(value)
    if reader is not from_micro:
        assert value is None or value >= -273.15


@every_reader
@pytest.mark.parametrize(
    "content",
    [b"", b"\n", b"-", b"--1", b"nan", b"1e3", b"26.5", b"0x1F", b"1_000", b"+5", b"12 13", b"25000\n26000\n",
     b"9" * 32, "٣٤".encode()],
)  # fmt: skip
def test_what_is_no_number_is_missing(reader, content):
    assert reader(content) is None


def test_absolute_zero_itself_is_a_temperature():
    assert degC_from_millidegrees(b"-273150\n") == -273.15
    assert degC_from_tenths(b"-2731\n") == -273.1
    assert (degC_from_millidegrees(b"-273151\n"), degC_from_tenths(b"-2732\n")) == (None, None)
