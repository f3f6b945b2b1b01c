"""The shipped alerts fire on what the daemon publishes and on its absence, as the real promtool evaluates them."""

import json
from pathlib import Path

import pytest

from processes import ran

RULES = Path(__file__).resolve().parents[2] / "deploy" / "node-exporter" / "ambientd.rules.yml"
ONE, FILE = '{instance="a"}', '{instance="a",file="/var/lib/prometheus/node-exporter/ambientd.prom"}'
SERIES = {
    "AmbientdGone": {f"node_textfile_scrape_error{ONE}": "0x5 1x30"},
    "AmbientdFaulted": {'ambientd_status{instance="a",status="faulted"}': "0x5 1x30"},
    "AmbientdStale": {f"node_textfile_mtime_seconds{FILE}": "0+60x5 300x30"},
    "AmbientdSensorMissing": {
        'ambientd_sensor_raw{instance="a",sensor="usb"}': "20x40",
        'ambientd_sensor_raw{instance="a",sensor="battery"}': "20x5 stale",
        'ambientd_sensor_used{instance="a",sensor="usb"}': "20x40",
        'ambientd_sensor_used{instance="a",sensor="battery"}': "20x40",
    },
    "AmbientdTicksMissed": {f"ambientd_missed_ticks{ONE}": "0x5 0+5x30"},
}
SERIES["AmbientdGone"][f"ambientd_missed_ticks{ONE}"] = "3x40"


@pytest.fixture
def promtool(program, tmp_path):
    return lambda *words: ran(program("promtool"), *words, cwd=tmp_path)


def test_each_rule_is_valid_and_has_a_case(promtool):
    promtool("check", "rules", RULES)
    alerts = [line.partition("alert: ")[2] for line in RULES.read_text().splitlines() if "alert: " in line]
    assert {*alerts} == SERIES.keys()


@pytest.mark.parametrize("alert", SERIES)
def test_it_fires_after_the_fault_and_not_before(alert, promtool, tmp_path):
    series = [{"series": name, "values": values} for name, values in SERIES[alert].items()]
    names = [
        {
            "expr": f'count(ALERTS{{alertname="{alert}",alertstate="firing"}}) or vector(0)',
            "eval_time": at,
            "exp_samples": [{"labels": "{}", "value": count}],
        }
        for at, count in (("5m", 0), ("25m", 1))
    ]
    case = {"interval": "1m", "input_series": series, "promql_expr_test": names}
    cases = tmp_path / "cases.yml"  # JSON is YAML, too
    cases.write_text(json.dumps({"rule_files": [str(RULES)], "evaluation_interval": "1m", "tests": [case]}))
    promtool("test", "rules", cases)
