"""A hwmon temperature is found by chip and label, whatever number it has at this boot."""

import pytest

from ambientd.sources.hwmon import Hwmon, HwmonTemperature, find_hwmon


@pytest.fixture
def board(make_hwmon):
    """Two chips, one of them twice."""
    make_hwmon(10, "nct6775", (1, "SYSTIN", "41000\n"), (2, "CPUTIN", "52500\n"), (10, "PECI", "60000\n"))
    make_hwmon(2, "nvme", (1, "Composite", "38850\n"), (3, None, "40850\n"))
    make_hwmon(3, "nvme", (1, "Composite", "29850\n"))
    return make_hwmon.root


def test_chips_and_labels_are_found_in_the_order_of_their_numbers(board):
    folder = f"{board}/class/hwmon"
    assert find_hwmon(str(board)) == {
        ("nvme", "Composite"): [f"{folder}/hwmon2/temp1_input", f"{folder}/hwmon3/temp1_input"],
        ("nvme", "temp3"): [f"{folder}/hwmon2/temp3_input"],
        ("nct6775", "SYSTIN"): [f"{folder}/hwmon10/temp1_input"],
        ("nct6775", "CPUTIN"): [f"{folder}/hwmon10/temp2_input"],
        ("nct6775", "PECI"): [f"{folder}/hwmon10/temp10_input"],
    }


def test_what_is_no_temperature_or_has_no_name_is_passed_over(board):
    folder = board / "class/hwmon/hwmon10"
    for name in ("temp2_max", "fan1_input", "in0_input", "temp_input", "tempX_input"):
        (folder / name).write_text("1\n")
    before = find_hwmon(str(board))
    (board / "class/hwmon/hwmon3/name").unlink()
    del before["nvme", "Composite"][1]
    assert find_hwmon(str(board)) == before


def test_no_hwmon_class_is_no_temperatures(tmp_path):
    assert find_hwmon(str(tmp_path)) == {}
    source = HwmonTemperature(Hwmon("nvme", "Composite"), str(tmp_path))
    assert source.find() == []
    assert source.absent == "no hwmon chip 'nvme' with a temperature labelled 'Composite'"
    assert source.hint() == "temperatures here are none: name one of them under 'sensors'"
