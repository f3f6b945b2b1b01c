"""A configuration is taken whole, or refused with every fault in one message."""

import json
import os
from pathlib import Path

import pytest

from ambient_model.faults import Refused
from ambientd.config import Settings, load_settings, settings_for_model
from ambientd.publish.file import Options
from ambientd.publish.spec import Spec, parse

DEPLOY = Path(__file__).parents[2] / "deploy"


def saved(tmp_path, text, name="ambientd.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


def refusal(path):
    with pytest.raises(Refused) as refused:
        load_settings(path)
    return str(refused.value)


WHOLE = {
    "model": "phone.json",
    "rate_hz": 10,
    "sysfs_root": "/fake",
    "level_percent": 98,
    "zones": {"usb": "usbc-therm-adc"},
    "publish": [
        "stdout",
        "file-in-place:/run/a",
        "socket:s",
        {"kind": "file", "path": "/run/b", "mode": "in-place", "poison_millidegC": -274000},
    ],
}


def test_every_key_is_taken_the_same_from_json_and_yaml(tmp_path):
    text = json.dumps(WHOLE)  # which is YAML, too
    for name in ("c.json", "c.yaml"):
        path = saved(tmp_path, text, name)
        assert load_settings(path) == Settings(
            source=path,
            model=str(tmp_path / "phone.json"),
            rate_hz=10.0,
            sysfs_root="/fake",
            publish=(
                Spec("stdout"),
                Spec("file-in-place", "/run/a"),
                Spec("socket", str(tmp_path / "s")),
                Spec("file-in-place", "/run/b", options=Options(poison_millidegC=-274000)),
            ),
            level_percent=98,
            zones={"usb": "usbc-therm-adc"},
        )


def test_the_model_alone_is_enough(tmp_path):
    path = saved(tmp_path, "model: /m.json\n")
    assert load_settings(path) == settings_for_model("/m.json")._replace(source=path)
    assert settings_for_model("m.json")[1:7] == ("m.json", 1.0, "/sys", (Spec("stdout"),), 90, {})


def test_every_fault_is_named_at_once(tmp_path):
    path = saved(
        tmp_path,
        """
rate_hz: 50
sysfs_root: 7
level_percent: 95
zones: [usb]
poll: 3
publish:
  - mqtt:broker
  - file
  - stdout:x
  - 12
  - {kind: file, path: /run/a, mode: append, poison_millidegC: 1.5, owner: root}
  - {kind: socket, path: /run/a, mode: rename}
""",
    )
    kinds = "file, file-in-place, prometheus, socket, status, stdout"
    assert refusal(path).splitlines() == [
        f"{path}: 15 faults",
        "  poll: unknown key; known are model, rate_hz, sysfs_root, publish, level_percent, zones, coast_s, state,"
        " zones_by_name, sensors, supervision, access",
        "  model: missing; name the model file",
        "  rate_hz: is 50; a number between 0.1 and 20 is wanted",
        "  sysfs_root: is 7; a text is wanted",
        f"  publish[0]: 'mqtt' is no kind of publisher; known are {kinds}",
        "  publish[1]: 'file' has no path; write file:PATH",
        "  publish[2]: 'stdout:x' has a path; stdout takes none",
        "  publish[3]: is 12; KIND:PATH or a mapping is wanted",
        "  publish[4].owner: unknown key; known are kind, path, mode, poison_millidegC,"
        " offset_millidegC, at_exit, access",
        "  publish[4].mode: is 'append'; one of rename, in-place is wanted",
        "  publish[4].poison_millidegC: is 1.5; an integer in millidegrees, of at most 12 digits, is wanted",
        "  publish[5].mode: unknown key; known are kind, path, access",
        "  publish: /run/a stands twice; publish each to a path of its own",
        "  level_percent: is 95; one of 50, 90, 98 is wanted",
        "  zones: is ['usb']; a mapping from input name to thermal zone type is wanted",
    ]


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ("", "c.yaml", "holds no keys; start with 'model: MODEL.json'; known keys are"),
        ("model: a\nmodel: b\n", "c.yaml", "key 'model' stands twice in one mapping; correct it"),
        ('{"model": "a", "model": "b"}', "c.json", "key 'model' stands twice in one mapping; correct it"),
        ("model: a\nzones: {usb: x, usb: y}\n", "c.yaml", "key 'usb' stands twice in one mapping"),
        ("model: [a\n", "c.yaml", "line 2, column 1: not YAML (expected ',' or ']'"),
        ("model: a", "c.json", "line 1, column 1: not JSON (Expecting value); correct it there"),
        ("model: a\x07b", "c.yaml", "special characters are not allowed"),
        ("model: a\nrate_hz: true\n", "c.yaml", "rate_hz: is True; a number between 0.1 and 20 is wanted"),
        ("model: a\nrate_hz: .nan\n", "c.yaml", "rate_hz: is nan; a number between 0.1 and 20 is wanted"),
        ("model: a\npublish: []\n", "c.yaml", "publish: is []; a list of KIND:PATH or of mappings is wanted"),
    ],
)
def test_each_is_refused(tmp_path, text, name, message):
    assert message in refusal(saved(tmp_path, text, name))


def test_files_that_cannot_be_read_are_refused(tmp_path):
    assert "cannot be read (No such file or directory)" in refusal(str(tmp_path / "none.yaml"))
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00model")
    assert "not text" in refusal(str(tmp_path / "bytes.yaml"))


@pytest.mark.parametrize("text", ["file:/a:b", "file-in-place:/a", "status:/s", "prometheus:/p", "socket:/s", "stdout"])
def test_a_publishers_name_reads_back(text):
    assert str(parse(text)) == text


def test_the_shipped_configuration_loads():
    settings = load_settings(str(DEPLOY / "ambientd.yaml"))
    assert os.path.isabs(settings.model)
    assert all(spec.path.startswith("/run/ambientd/") for spec in settings.publish if spec.path)


def test_the_shipped_unit_starts_the_shipped_configuration():
    unit = (DEPLOY / "ambientd.service").read_text()
    settings = load_settings(str(DEPLOY / "ambientd.yaml"))
    assert "ExecStart=/usr/bin/env ambientd run --config /etc/ambientd/ambientd.yaml\n" in unit
    assert "RuntimeDirectory=ambientd\n" in unit
    assert settings.model == "/etc/ambientd/model.json"
