"""A battery's temperature, current and voltage are found by its folder and told in degC, A and V."""

import math

from ambientd.sources.power_supply import PowerSupply, PowerSupplyProperty


def value(root, location):
    (path,) = PowerSupplyProperty(location, str(root)).find()
    with open(path, "rb") as stream:
        return PowerSupplyProperty(location, str(root)).value(stream.read())


def test_each_property_in_its_unit(make_supply):
    root = make_supply("battery", temp="-53\n", current_now="-1500000\n", voltage_now="3912500\n")
    expected = {"temp": (-5.3, "degC"), "current_now": (-1.5, "A"), "voltage_now": (3.9125, "V")}
    for name, (number, unit) in expected.items():
        location = PowerSupply("battery", name)
        assert (value(root, location), PowerSupplyProperty(location, str(root)).unit) == (number, unit)


def test_a_vendor_that_counts_the_other_way(make_supply):
    root = make_supply("battery", current_now="-1500000\n")
    assert value(root, PowerSupply("battery", "current_now", -1)) == 1.5


def test_no_current_is_no_negative_zero(make_supply):
    root = make_supply("battery", current_now="0\n")
    assert math.copysign(1.0, value(root, PowerSupply("battery", "current_now", -1))) == 1.0


def test_what_is_not_here_is_said_with_what_is(make_supply):
    make_supply("usb", voltage_now="5000000\n")
    make_supply("bms", current_now="1\n", voltage_now="1\n")
    root = make_supply("ac", online="1\n")
    source = PowerSupplyProperty(PowerSupply("battery", "voltage_now"), str(root))
    assert source.find() == []
    assert source.absent == "no property 'voltage_now' of a power supply 'battery'"
    assert source.hint() == "supplies here with it are bms, usb: name one of them under 'sensors'"
    bare = PowerSupplyProperty(PowerSupply("battery", "temp"), "/nowhere")
    assert (bare.find(), bare.hint()) == ([], "supplies here with it are none: name one of them under 'sensors'")
