import pytest

from ambient_trainer.data.probe_offsets import ProbeOffset
from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments.agilent_34970a import Driver, Simulated
from ambient_trainer.laboratory.messages import InstrumentError
from breaking import distort, open_probe

CHANNELS = {"c101": 101, "c102": 102, "c103": 103, "c105": 105, "c203": 203}


def named(port="/nowhere/port", probes=CHANNELS, **values):
    return settings("agilent-34970a", port=port, probes=probes, **values)


def offset(*points):
    data = [{"reading_degC": at, "offset_K": offset_K, "standard_error_K": 0.0} for at, offset_K in points]
    return ProbeOffset.model_validate({"points": data})


@pytest.fixture
def simulated(clock, closed):
    """Five channels at their own temperatures: 10.1 degC on 101, and so on."""
    errors_K = {name: channel / 10.0 for name, channel in CHANNELS.items()}
    return closed(Simulated(named(), clock, lambda at_s: 0.0, 0, errors_K))


@pytest.fixture
def driver(simulated, clock, closed):
    """Makes drivers of it."""
    return lambda probes, offsets=None: closed(Driver(named(simulated.port, probes), clock, offsets))


def temps(multiplexer):
    return [value if value is None else round(value, 1) for value in multiplexer.read().values.values()]


def test_each_probes_offset_is_added(driver, simulated):
    open_probe(simulated.probes[103])
    offsets = {"a": offset((0.0, 5.0)), "b": offset((0.0, 0.0), (20.4, 20.0)), "c": offset((0.0, 1.0))}
    found = driver({"a": 101, "b": 102, "c": 103, "d": 105}, offsets).read().values
    assert list(found.values()) == [
        pytest.approx(15.1, abs=0.1),
        pytest.approx(20.2, abs=0.2),
        None,
        pytest.approx(10.5, abs=0.1),
    ]


def other_channel(reply):
    return reply.replace(b",101,", b",103,")


@pytest.mark.parametrize(
    ("spoil", "probes", "expected", "got"),
    [
        (lambda simulated: list(simulated._execute("*RST")), {"a": 101}, "(@101)", '-221,"Settings conflict"'),
        (lambda simulated: distort(simulated, other_channel), {"a": 101, "b": 102}, "(@101,102)", "103"),
    ],
    ids=["its scan was forgotten", "of other channels"],
)
def test_readings_that_are_none_of_its_channels_are_refused_and_asked_for_anew(
    driver, simulated, spoil, probes, expected, got
):
    multiplexer = driver(probes)
    multiplexer.read()
    spoil(simulated)
    with pytest.raises(InstrumentError) as caught:
        multiplexer.read()
    assert (expected in caught.value.expected, got in caught.value.got) == (True, True)
    assert temps(multiplexer) == [10.1, 10.2][: len(probes)]


def test_a_channel_that_is_not_there_is_the_instruments_own_complaint(driver):
    with pytest.raises(InstrumentError) as caught:
        driver({"a": 301}).configure()
    assert '-224,"Illegal parameter value"' in caught.value.got
