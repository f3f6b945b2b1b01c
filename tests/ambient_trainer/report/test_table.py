"""A table on a terminal of the usual width."""

from rich.console import Console

from ambient_trainer.report.table import Table, for_terminal


def shown(table: Table, width: int) -> list[str]:
    console = Console(width=width, color_system=None)
    with console.capture() as capture:
        console.print(for_terminal(table))
    return capture.get().splitlines()


def test_a_narrow_terminal_folds_names_and_keeps_figures() -> None:
    columns = ("trace", "method", *(f"figure {k}" for k in range(5)))
    table = Table("", columns, (("a_rather_long_name_of_a_trace.csv", "static linear", *["-12.34"] * 5),), labels=2)

    lines = shown(table, 72)

    assert max(map(len, lines)) <= 72
    assert sum(line.count("-12.34") for line in lines) == 5
    assert "".join(line[1:].split("  ")[0] for line in lines[3:]) == "a_rather_long_name_of_a_trace.csv"


def test_cells_are_text() -> None:
    assert "[bold]x[/bold]" in "\n".join(shown(Table("", ("a",), (("[bold]x[/bold]",),)), 80))
