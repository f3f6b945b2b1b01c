"""A report as a page and on a terminal: all its text is text, and its colours have counterparts in the dark."""

import html
import os
import re

from rich.console import Console

from ambient_trainer.report import Facts, Figure, Finding, Report, Section, Table
from ambient_trainer.report.page import page_of, write_report
from ambient_trainer.report.palette import SENSOR_COLOURS, sensor_colours
from ambient_trainer.report.plots import panel_figure
from ambient_trainer.report.terminal import for_terminal, print_report
from refusals import refused

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
    assert "taken/report" in str(refused(write_report, str(tmp_path / "taken" / "report"), Report("page", [], [], {})))
    assert (tmp_path / "taken").read_text() == "mine"


def test_text_is_text_wherever_it_stands():
    findings = [Finding(HOSTILE, label=HOSTILE), Finding(HOSTILE), Finding(HOSTILE, value=HOSTILE)]
    blocks = [HOSTILE, *findings, Facts([(HOSTILE, [HOSTILE, HOSTILE])]), Table(HOSTILE, [HOSTILE], [[HOSTILE]])]
    page = page_of(Report(HOSTILE, blocks, [Section(HOSTILE, [*blocks, Section(HOSTILE, blocks)])], {}, "", [HOSTILE]))
    assert page.count(SAFE) == 3 * 12 + 4  # the title, two headings, a footnote
    assert "<b>" not in page
    assert "<i>" not in page


def test_plots_are_numbered_and_sections_listed(tmp_path):
    figure = Figure(lambda: panel_figure("a", "b", 200), "caption")
    page = page_of(Report("title", [figure], [Section(f"part {k}", [figure]) for k in range(6)], {}))
    assert sorted(re.findall(r'id="(figure-\d)"', page)) == [f"figure-{k}" for k in range(1, 8)]
    for target in re.findall(r'href="#([^"]+)"', html.unescape(page)):
        assert f'id="{target}"' in page


def test_a_sensor_has_one_colour_wherever_it_is_drawn():
    phone = sensor_colours(["usb", "flash", "battery", "soc", "display"])
    assert sensor_colours(["display", "soc", "battery", "flash", "usb"]) == phone
    assert len(set(phone.values())) == 5
    assert set(sensor_colours(map(str, range(50))).values()) == set(SENSOR_COLOURS)


def shown(draw, width=100):
    console = Console(width=width, color_system=None)
    with console.capture() as capture:
        draw(console)
    return capture.get().splitlines()


def test_a_terminal_shows_titles_findings_and_tables_in_order():
    hidden = Section("hidden", [Finding("too much")], detail=True)
    figure = Figure(lambda: 1 / 0)  # drawn for a page only
    report = Report(
        "first: [b]1[/b] degC",
        [Finding("second", "warning"), None, Facts([("no", "fact")])],
        [
            Section("third", ["a note", Finding("fourth", "good", label="cause"), figure, Section("fifth", [hidden])]),
            hidden,
            Section("sixth", [Section("seventh", [Table("", ("a",), (("[bold]x[/bold]",),)), "a note"])]),
            Section("empty", ["a note"]),
        ],
        {},
    )
    text = "\n".join(shown(lambda console: print_report(console, report)))
    order = ["first: [b]1[/b] degC", "second", "third", "cause: fourth", "sixth", "seventh", "[bold]x[/bold]"]
    assert sorted(order, key=text.index) == order
    for absent in ("too much", "hidden", "fact", "note", "fifth", "empty"):
        assert absent not in text


def test_a_narrow_terminal_folds_names_and_keeps_figures():
    columns = ("trace", "method", *(f"figure {k}" for k in range(5)))
    table = Table("", columns, (("a_rather_long_name_of_a_trace.csv", "static linear", *["-12.34"] * 5),), labels=2)
    lines = shown(lambda console: console.print(for_terminal(table)), 72)
    assert max(map(len, lines)) <= 72
    assert sum(line.count("-12.34") for line in lines) == 5
    assert "".join(line[1:].split("  ")[0] for line in lines[3:]) == "a_rather_long_name_of_a_trace.csv"
