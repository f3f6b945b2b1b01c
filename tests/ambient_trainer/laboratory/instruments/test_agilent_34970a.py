import pytest

from ambient_trainer.data.probe_offsets import ProbeOffset
from ambient_trainer.laboratory.instruments.agilent_34970a import Driver
from ambient_trainer.laboratory.messages import InstrumentError
from breaking import distort, open_probe

from .conftest import settings_of


def test_each_probes_offset_is_added(bench, closed):
    bench = bench("multiplexer")
    open_probe(bench.simulated.probes[102])
    offset = ProbeOffset.model_validate({"points": [{"reading_degC": 0.0, "offset_K": 5.0, "standard_error_K": 0.0}]})
    named = settings_of("multiplexer", bench.simulated.port, probes={"a": 101, "b": 102, "c": 103})
    multiplexer = closed(Driver(named, bench.clock, {"a": offset, "b": offset}))
    expected = [pytest.approx(26.6, abs=0.1), None, pytest.approx(21.5, abs=0.1)]
    assert list(multiplexer.read().values.values()) == expected


@pytest.mark.parametrize(
    ("spoil", "probes", "expected", "got"),
    [
        (lambda simulated: list(simulated._execute("*RST")), {"air": 101}, "(@101)", '-221,"Settings conflict"'),
        (
            lambda it: distort(it, lambda reply: reply.replace(b",101,", b",103,")),
            {"air": 101, "b": 102},
            "(@101,102)",
            "103",
        ),
    ],
    ids=["its scan was forgotten", "of other channels"],
)
def test_readings_that_are_none_of_its_channels_are_refused_and_asked_for_anew(bench, spoil, probes, expected, got):
    bench = bench("multiplexer", probes=probes)
    bench.driver.read()
    spoil(bench.simulated)
    error = bench.failure()
    assert (expected in error.expected, got in error.got) == (True, True)
    assert bench.reading() == pytest.approx(21.6, abs=0.1)


def test_a_channel_that_is_not_there_is_the_instruments_own_complaint(bench):
    with pytest.raises(InstrumentError) as caught:
        bench("multiplexer", probes={"a": 301}).driver.configure()
    assert '-224,"Illegal parameter value"' in caught.value.got
