"""An iio temperature is found by device and channel, and scaled as the kernel documents."""

import pytest

from ambientd.sources.iio import Iio, IioTemperature, find_iio


@pytest.fixture
def board(tmp_path):
    """The sensors of a Sense HAT, a BME280 as on Enviro+, and a light sensor, as their drivers show them."""
    devices = {
        0: {"name": "bme280", "in_temp_input": "22910", "in_pressure_input": "100.1"},
        10: {"name": "lps25h", "in_temp_raw": "-8350", "in_temp_offset": "20400", "in_temp_scale": "2.083333"},
        2: {"name": "hts221", "in_temp_raw": "136", "in_temp_offset": "1148.461538", "in_temp_scale": "16.25"},
        3: {"name": "mlx90614", "in_temp_ambient_raw": "14700", "in_temp_ambient_offset": "-13657.5"}
        | {"in_temp_ambient_scale": "20", "in_temp_object_input": "21937.500000"},
        4: {"name": "ltr559", "in_illuminance_input": "81"},
    }
    for number, files in devices.items():
        folder = tmp_path / "bus/iio/devices" / f"iio:device{number}"
        folder.mkdir(parents=True)
        for name, content in files.items():
            (folder / name).write_text(f"{content}\n")
    return tmp_path


def value_of(root, device, channel):
    source = IioTemperature(Iio(device, channel), str(root))
    [path] = source.find()
    with open(path, "rb") as stream:
        return source.value(stream.read())


@pytest.mark.parametrize(
    ("device", "channel", "degC"),
    [
        ("bme280", "in_temp", 22.91),
        ("lps25h", "in_temp", (20400 - 8350) * 2.083333e-3),
        ("hts221", "in_temp", 20.8725),
        ("mlx90614", "in_temp_ambient", 20.85),
        ("mlx90614", "in_temp_object", 21.9375),
    ],
)
def test_each_driver_s_form_is_read_in_degC(board, device, channel, degC):
    assert value_of(board, device, channel) == pytest.approx(degC)


def test_only_temperatures_of_named_devices_are_found(board):
    (board / "bus/iio/devices/iio:device0/name").unlink()
    assert [str(each) for each in find_iio(str(board))] == [
        "iio hts221 in_temp",
        "iio mlx90614 in_temp_ambient",
        "iio mlx90614 in_temp_object",
        "iio lps25h in_temp",
    ]


@pytest.mark.parametrize(("attribute", "content"), [("scale", "x"), ("offset", "inf"), ("raw", "-"), ("raw", "1e3")])
def test_what_is_no_number_is_no_value(board, attribute, content):
    (board / "bus/iio/devices/iio:device2" / f"in_temp_{attribute}").write_text(f"{content}\n")
    assert value_of(board, "hts221", "in_temp") is None


def test_none_is_here(tmp_path):
    source = IioTemperature(Iio("hts221", "in_temp"), str(tmp_path))
    assert source.find() == []
    assert "none" in source.hint()
