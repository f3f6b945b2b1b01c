"""A report on a terminal: what it shows in which order, and tables of the usual width."""

from rich.console import Console

from ambient_trainer.report import Facts, Figure, Finding, Report, Section, Table
from ambient_trainer.report.terminal import for_terminal, print_report


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
