"""``ambientd check``: the model, its self-consistency, the sensors that its inputs are read from, and the outputs."""

import json
import pwd
import re
from pathlib import Path

import pytest

from ambient_model.codec import encode
from ambient_model.model import Input
from ambientd import consumers
from ambientd.publish.file import Options
from ambientd.publish.spec import Spec

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


@pytest.fixture
def check(ambientd):
    """Run the command: of what it prints and refuses each line by its subject."""

    def run(*arguments, status=0):
        done = ambientd("check", *arguments, status=status)
        printed = [
            line.split(maxsplit=1) if line[0] != " " else ["", line.strip()] for line in done.stdout.splitlines()
        ]
        faults = dict(
            re.findall(r"^ *(?:ambientd: )?((?:sensor|input|sensors\.|zones\.|output)[^:]*): (.*)", done.stderr, re.M)
        )
        return printed, faults or done.stderr

    return run


def test_it_prints_the_model_and_reads_its_sensors(check, make_model, saved, phone):
    printed, refused = check("--model", saved(make_model(fallbacks=True)), "--sysfs-root", phone.root)
    assert refused == ""
    zones = f"{phone.root}/class/thermal/thermal_zone"
    estimator = ("model", "input", "input", "states", "periods", "interval", "fallbacks")
    assert [subject for subject, _ in printed] == [*estimator, "conformance", "", "sensor", "sensor"]
    text = [text for _, text in printed]
    assert text[1:5] == [
        "usb_degC, -20 to 90, zone usb-therm",
        "battery_degC, -20 to 70, zone battery",
        "usb_lagged, battery_lagged",
        "0.1, 0.2, 0.5, 1 s",
    ]
    assert re.match(r"-0.5 to \+0.75 degC .* 90 %", text[5])
    assert re.match(r"passed: 20 samples at 4 periods", text[7])
    assert re.match(r"passed: 2 fallbacks", text[8])
    assert text[-2:] == [f"usb, {zones}10/temp: 30 degC", f"battery, {zones}3/temp: 25 degC"]


def test_on_a_host_missing_sensors_are_only_reported(check, model_file):
    printed, refused = check("--model", model_file)
    assert refused == ""
    assert [text for subject, text in printed if subject == "sensor"] == [
        "usb: no thermal zone of type 'usb-therm'",
        "battery: no thermal zone of type 'battery'",
    ]


def damaged(estimator, matrix):
    """The estimator with a coefficient of its second period off by 1e-3."""
    discrete = estimator.discrete[1]
    row, *rows = getattr(discrete, matrix)
    wrong = discrete._replace(**{matrix: ((row[0] + 1e-3, *row[1:]), *rows)})
    return estimator._replace(discrete=(estimator.discrete[0], wrong, *estimator.discrete[2:]))


def test_what_contradicts_itself_is_a_warning(check, make_model, saved):
    model = make_model(fallbacks=True, guarded=True)
    wrong = model._replace(
        fallbacks={**model.fallbacks, "battery": damaged(model.fallbacks["battery"], "B")},
        secondary=model.secondary._replace(estimator=damaged(model.secondary.estimator, "A")),
    )
    printed, refused = check("--model", saved(wrong))
    assert refused == ""
    warnings = [text for subject, text in printed if subject == "warning"]
    # most where usb goes from 25 to 26 degC: 1e-3 * 26 beside the 25.00995 degC that a right step of 0.2 s reaches
    assert "without battery" in warnings[0]
    assert "0.00103959" in warnings[0]
    assert "secondary" in warnings[1]
    assert len(warnings) == 2
    assert "rate of change, with the difference" in dict(printed)["interval"]
    assert "1 degC" in dict(printed)["secondary"]


def test_a_recursion_that_does_not_give_the_files_outputs_fails(check, model_file):
    data = json.loads(Path(model_file).read_text())
    data["conformance"]["outputs"][3]["values"][7] += 1e-6
    Path(model_file).write_text(json.dumps(data))
    _, refused = check("--model", model_file, status=1)
    assert f"{model_file}: conformance: " in refused
    assert "1e-06" in refused


POWERED = (Input("inlet", "degC", "inlet", -20.0, 90.0), Input("battery_current", "A", "battery_current", -5.0, 5.0))
WHOLE = {
    "inlet": {"hwmon": "board", "label": "inlet"},
    "battery_current": {"power_supply": "bms", "property": "current_now", "sign": -1},
}


@pytest.fixture
def powered(make_model, make_hwmon, make_supply, write):
    """A model of a temperature and a current, its device, and a configuration with a sensors mapping."""
    write("powered.json", encode(make_model(POWERED)))
    make_hwmon(1, "board", (1, "inlet", "21500\n"))
    root = make_supply("bms", current_now="-750000\n", voltage_now="4100000\n")
    keys = {"model": "powered.json", "sysfs_root": str(root)}
    return lambda sensors, **more: write("powered-c.json", json.dumps({**keys, "sensors": sensors, **more}))


def test_each_configured_sensor_is_read_and_the_first_of_a_name_is_named(check, powered, make_hwmon, sysfs):
    printed, refused = check("--config", powered(WHOLE))
    assert refused == ""
    assert [text for subject, text in printed if subject == "input"] == [
        "inlet_degC, -20 to 90, hwmon board inlet",
        "battery_current_A, -5 to 5, power_supply bms current_now",
    ]
    sensors = [text for subject, text in printed if subject == "sensor"]
    root = f"{sysfs.root}/class"
    assert sensors == [
        f"inlet, {root}/hwmon/hwmon1/temp1_input: 21.5 degC",
        f"battery_current, {root}/power_supply/bms/current_now: 0.75 A",
    ]
    folder = make_hwmon(0, "board", (1, "inlet", "19000\n"))
    printed, _ = check("--config", powered(WHOLE))
    assert re.match(rf"inlet, {folder}/temp1_input: 19 degC, .* 2 ", dict(printed[:-1])["sensor"])


def test_every_sensor_that_gives_no_usable_value_is_named_with_what_is_here(check, powered, sysfs, model_file):
    (sysfs.root / "class/power_supply/bms/current_now").write_text("-7500000\n")
    _, refused = check("--config", powered({**WHOLE, "inlet": {"hwmon": "board", "label": "outlet"}}), status=1)
    assert refused.keys() == {"sensor inlet", "sensor battery_current"}
    assert "'outlet'" in refused["sensor inlet"]
    assert "{hwmon: board, label: inlet}" in refused["sensor inlet"]
    assert "7.5 A is outside -5 to 5" in refused["sensor battery_current"]
    sysfs.zone(0, "cpu", "40000\n")
    sysfs.zone(1, "usb-therm", "-274000\n")
    _, refused = check("--model", model_file, "--sysfs-root", sysfs.root, status=1)
    assert "-274000" in refused["sensor usb"]
    assert all("types here are cpu, usb-therm:" in each for each in refused.values())


def test_a_sensor_in_another_unit_or_for_no_input_is_refused(check, powered):
    wrong = {
        "inlet": {"power_supply": "bms", "property": "voltage_now"},
        "battery_current": {"zone": "battery"},
        "skin": {"zone": "skin"},
    }
    _, refused = check("--config", powered(wrong), status=1)
    assert refused.keys() == {"sensors.skin", "sensors.inlet", "sensors.battery_current"}
    assert "inlet, battery_current" in refused["sensors.skin"]
    assert "in V, and the input in degC" in refused["sensors.inlet"]
    _, refused = check("--config", powered({}), status=1)
    assert "powered.json: input battery_current: is in A" in refused
    assert "power_supply for it, 'sensors.battery_current'" in refused
    _, refused = check("--config", powered(WHOLE, zones={"soc": "cpu-0-0"}), status=1)
    assert "zones.soc: " in refused


def test_one_sensor_for_two_inputs_is_refused(check, model_file, write):
    twice = json.dumps({"model": str(model_file), "zones": {"usb": "battery"}})
    _, refused = check("--config", write("twice.json", twice), status=1)
    assert "input battery: is read from zone battery, as usb is" in refused


def test_the_daemon_reads_every_kind_and_finds_a_renumbered_one_again(
    start, until, ended, powered, make_hwmon, sysfs, status, tmp_path
):
    def raw():
        return {name: each["raw"] for name, each in status().get("sensors", {}).items()}

    daemon = start("run", "--config", powered(WHOLE), "--rate", "20", "--publish", f"status:{tmp_path}/status")
    until(lambda: raw() == {"inlet": 21.5, "battery_current": 0.75})
    chip = sysfs.root / "class/hwmon/hwmon1"
    (chip / "temp1_input").write_text("")
    until(lambda: raw()["inlet"] is None)
    chip.rename(tmp_path / "gone")
    make_hwmon(5, "board", (2, "inlet", "22500\n"))
    until(lambda: raw() == {"inlet": 22.5, "battery_current": 0.75})
    code, _, log = ended(daemon)
    assert code == 0
    assert [line.partition("(")[0] for line in log.splitlines()[1:]] == [
        "ambientd: sensor inlet: no value ",
        "ambientd: sensor inlet: is back",
    ]


@pytest.mark.parametrize(
    ("content", "unit"), [("31\n", "reports degrees"), ("310\n", "reports tenths"), ("31000\n", None), ("0\n", None)]
)
def test_a_zone_in_another_unit_is_named(check, model_file, sysfs, content, unit):
    sysfs.zone(0, "usb-therm", content)
    sysfs.zone(1, "battery", "30000\n")
    printed, refused = check("--model", model_file, "--sysfs-root", sysfs.root, status=0 if unit is None else 1)
    assert unit is None or ("sensor usb" in str(refused) and unit in str(refused))
    assert ("warning" in dict(printed)) == (content == "0\n"), "what sensors read that have no value"


CONSUMERS = {
    "thermald": ("etc/thermald/thermal-conf.xml", "thermald/thermal-conf.xml"),
    "pixel-hal": ("vendor/etc/thermal_info_config.json", "pixel/thermal_info_config.json"),
}
"""Where each looks on a device, and what is shipped for it."""


@pytest.fixture
def followed(tmp_path):
    """The chain from a file, published with some options, to consumers with the shipped configuration or an edited one,
    on a device whose root is a folder."""
    run, root = tmp_path / "run", tmp_path / "root"
    run.mkdir()

    def follow(options, consumer=None, *edit):
        if consumer is not None:
            where, shipped = (root / CONSUMERS[consumer][0], DEPLOY / CONSUMERS[consumer][1])
            where.parent.mkdir(parents=True)
            text = re.sub("/(run|dev)/ambientd", str(run), shipped.read_text())
            where.write_text(text.replace(*edit) if edit else text)
        spec = Spec("file", f"{run}/ambient_temp", options=Options(**options))
        found, faults = consumers.followed((spec, Spec("prometheus", f"{run}/ambient.prom")), str(root))
        return found, [(fault.place, fault.problem) for fault in faults]

    return follow


SAFE = {"poison_millidegC": 60000, "at_exit": "poison"}
SHUTS_DOWN = ('42.0, "NAN", "NAN"', '42.0, "NAN", 60.0')


@pytest.mark.parametrize(
    ("consumer", "options", "edit", "reads", "problem"),
    [
        ("thermald", SAFE, (), "from 30000", None),
        ("thermald", {}, (), "from 30000", "takes a missing file for 0 degC"),
        ("thermald", {"poison_millidegC": 60000}, (), "from 30000", "takes a missing file for 0 degC"),
        ("thermald", {**SAFE, "poison_millidegC": 25000}, (), "from 30000", "does not act on 25000"),
        ("thermald", SAFE, ("ambient_temp", "ambient_tmp"), None, "ambient_tmp"),
        ("pixel-hal", SAFE, (), "", None),
        ("pixel-hal", {**SAFE, "poison_millidegC": 40000}, (), "", "does not act"),
        ("pixel-hal", {}, (), "", "keeps its last"),
        ("pixel-hal", SAFE, SHUTS_DOWN, "", "shuts the device down"),
        ("pixel-hal", {**SAFE, "poison_millidegC": 40000}, SHUTS_DOWN, "", "does not act"),
    ],
)
def test_it_reports_what_a_consumer_does_after_a_fault(followed, consumer, options, edit, reads, problem):
    found, faults = followed(options, consumer, *edit)
    assert [each.startswith(f"{consumer} reads file:") and reads in each for each in found] == [True] * (
        reads is not None
    )
    assert [(place, problem in text) for place, text in faults] == [(f"consumer {consumer}", True)] * bool(problem)


def test_it_reports_a_reader_that_may_not_read(followed, tmp_path):
    """Debian's node_exporter, by the link of the guide, with its account where it is here."""
    text_files = tmp_path / "root/var/lib/prometheus/node-exporter"
    text_files.mkdir(parents=True)
    (text_files / "ambientd.prom").symlink_to(tmp_path / "run/ambient.prom")
    tmp_path.chmod(0o700)
    found, faults = followed(SAFE)
    assert ["node-exporter reads prometheus:" in each for each in found] == [True]
    (text_files / "apt.prom").write_text("")
    direct = consumers.followed((Spec("prometheus", f"{text_files}/own.prom"),), str(tmp_path / "root"))
    assert not [fault for fault in direct[1] if "apt.prom" in fault.problem]
    try:
        pwd.getpwnam("prometheus")
    except KeyError:
        pytest.skip("there is no user prometheus here")
    assert ["user prometheus" in problem for _, problem in faults] == [True]
