"""The real node_exporter scrapes the gauges through a link; as Debian starts it: test_under_systemd."""

import math
import re
import shutil
import socket
import subprocess
import urllib.error
import urllib.request

import pytest


@pytest.fixture
def scraped(spawn, until):
    """Start node_exporter on a folder of text files; the function returned scrapes it."""
    program = shutil.which("prometheus-node-exporter") or shutil.which("node_exporter")
    if program is None:
        pytest.skip("node_exporter is not installed")
    fetch = urllib.request.build_opener(urllib.request.ProxyHandler({})).open

    def start(folder):
        with socket.create_server(("127.0.0.1", 0)) as free:
            address = f"127.0.0.1:{free.getsockname()[1]}"
        only = ["--collector.disable-defaults", "--collector.textfile", f"--collector.textfile.directory={folder}"]
        spawn([program, *only, f"--web.listen-address={address}"], stdout=subprocess.DEVNULL)

        def scrape():
            try:
                with fetch(f"http://{address}/metrics", timeout=10) as answer:
                    return answer.read().decode()
            except urllib.error.URLError:
                return ""

        until(scrape, "node_exporter does not answer")
        return scrape

    return start


def test_the_gauge_is_scraped_follows_and_goes(scraped, weather, spawn, until, deployed, model_file, tmp_path):
    folder, published = tmp_path / "textfiles", tmp_path / "ambient.prom"
    folder.mkdir()
    (folder / "ambientd.prom").symlink_to(published)
    run = deployed("run", "--model", model_file, "--replay", weather.trace, "--speed", "0")
    weather.start(spawn, [*run, "--publish", f"prometheus:{published}"], ambient_degC=23.0)
    until(published.exists, "nothing was published")
    scrape = scraped(folder)

    def ambient():
        found = re.search(r'^ambientd_ambient_celsius\{model="phone"\} (\S+)$', scrape(), re.MULTILINE)
        return float(found[1]) if found else math.nan

    until(lambda: ambient() == pytest.approx(23.0), "23 degC is not scraped")
    page = scrape()
    assert "# TYPE ambientd_ambient_celsius gauge" in page
    assert "# HELP ambientd_ambient_celsius Estimated ambient temperature." in page
    assert 'ambientd_sensor_raw{sensor="usb",unit="degC"} 24.5' in page
    assert 'node_textfile_mtime_seconds{file="' in page
    assert "node_textfile_scrape_error 0" in page
    weather.say(-12.5)
    until(lambda: ambient() == pytest.approx(-12.5), "-12.5 degC is not scraped")
    assert weather.end() == 0
    page = scrape()
    assert "ambientd_" not in page.replace("ambientd.prom", "")
    assert "node_textfile_scrape_error 1" in page
