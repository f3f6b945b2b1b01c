"""A page is written whole, all its text is text, and its colours have counterparts in the dark."""

import html
import os
import re

import pytest

from ambient_model.faults import Refused
from ambient_trainer.report import Facts, Figure, Finding, Report, Section, Table
from ambient_trainer.report.page import page_of, write_report
from ambient_trainer.report.palette import SENSOR_COLOURS, sensor_colours

HOSTILE = "<b>x</b> & `<i>` 3 degC usb_degC"
SAFE = "&lt;b&gt;x&lt;/b&gt; &amp; <code>&lt;i&gt;</code> 3 °C usb_degC"


def test_the_page_and_its_script_replace_the_old_and_a_file_in_the_way_is_named(tmp_path):
    folder = tmp_path / "a" / "b"
    write_report(str(folder), Report("old", [], [], {}))
    assert write_report(str(folder), Report("new", [], [], {})) == str(folder / "index.html")
    assert "<h1>new</h1>" in (folder / "index.html").read_text()
    assert (folder / "plotly.min.js").stat().st_size > 1_000_000
    assert len(os.listdir(folder)) == 2
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(Refused, match="taken/report"):
        write_report(str(tmp_path / "taken" / "report"), Report("page", [], [], {}))
    assert (tmp_path / "taken").read_text() == "mine"


def test_text_is_text_wherever_it_stands():
    findings = [Finding(HOSTILE, label=HOSTILE), Finding(HOSTILE), Finding(HOSTILE, value=HOSTILE)]
    blocks = [HOSTILE, *findings, Facts([(HOSTILE, [HOSTILE, HOSTILE])]), Table(HOSTILE, [HOSTILE], [[HOSTILE]])]
    page = page_of(Report(HOSTILE, blocks, [Section(HOSTILE, [*blocks, Section(HOSTILE, blocks)])], {}, "", [HOSTILE]))
    assert page.count(SAFE) == 3 * 12 + 4  # the title, two headings, a footnote
    assert "<b>" not in page
    assert "<i>" not in page


def test_what_has_no_content_is_left_out_and_a_page_without_plots_loads_no_script():
    page = page_of(Report("title", [None, ""], [Section("empty", [None]), Section("full", [Finding("this")])], {}))
    assert "empty" not in page
    assert "<h2>full</h2>" in page
    assert "<script" not in page


def test_plots_are_numbered_and_sections_listed(tmp_path):
    from ambient_trainer.report.plots import panel_figure

    figure = Figure(lambda: panel_figure("a", "b", 200), "caption")
    page = page_of(Report("title", [figure], [Section(f"part {k}", [figure]) for k in range(6)], {}))
    assert sorted(re.findall(r'id="(figure-\d)"', page)) == [f"figure-{k}" for k in range(1, 8)]
    for target in re.findall(r'href="#([^"]+)"', html.unescape(page)):
        assert f'id="{target}"' in page


def test_a_sensor_has_one_colour_wherever_it_is_drawn():
    phone = sensor_colours(["usb", "flash", "battery", "soc", "display"])
    assert sensor_colours(["display", "soc", "battery", "flash", "usb"]) == phone
    assert len(set(phone.values())) == 5
    many = sensor_colours(map(str, range(50)))
    assert set(many.values()) == set(SENSOR_COLOURS)
