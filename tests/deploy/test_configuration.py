"""The shipped configuration: what stands in its comments is as good as what it says, and no key is kept quiet."""

import re
from pathlib import Path

import pytest

from ambientd.config import load_settings
from refusals import refused

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
LINES = (DEPLOY / "ambientd.yaml").read_text().splitlines()
COMMENTED = re.compile(r"^( *)# ((?:[a-zA-Z_]+: |- )[^ ].*)$")
SETTINGS = [number for number, line in enumerate(LINES) if COMMENTED.match(line)]


def loaded(write, uncommented):
    lines = [COMMENTED.sub(r"\1\2", line) if number in uncommented else line for number, line in enumerate(LINES)]
    return load_settings(write("ambientd.yaml", "\n".join(lines) + "\n"))


@pytest.mark.parametrize("number", SETTINGS, ids=[LINES[number].strip("# ").split(":")[0] for number in SETTINGS])
def test_each_commented_line_is_valid_without_its_hash(number, write):
    loaded(write, [number])


def test_all_together_are_valid_and_leave_no_key_out(write):
    loaded(write, SETTINGS)
    wrong = write("wrong.json", '{"nonsense": 1, "publish": [{"kind": "file", "path": "x", "nonsense": 1}]}')
    refusal = str(refused(load_settings, wrong))
    said = "\n".join(LINES)
    known = re.findall(r"nonsense: unknown key; known are (.*)", refusal)
    assert len(known) == 2
    assert [key for keys in known for key in keys.split(", ") if f"{key}:" not in said] == []
