"""One report for everything that a command shows: facts, findings, tables, figures, and what ``--json`` writes.

How to make the report of a result: one function ``report_of(result) -> Report`` in the package of the result, in a
module ``report.py``, that says what there is and nothing of where it is shown::

    def report_of(result: Result) -> Report:
        return Report(
            subject="Sensor search",
            title=f"2 sensors: {rmse:.2f} degC on held-out blocks",         # the result, with its figure
            lead=[
                Finding("It was trained on these samples.", "warning") if overlaps else None,    # None: left out
                Finding("Left and right together leave 0.31 degC.", "result"),
                Facts([("trace", result.path), ("sensors", "left, right")]),
            ],
            sections=[
                Section("How many sensors", [
                    Table(caption, columns, rows),
                    Finding("A third sensor gains less than 0.02 degC."),
                    Figure(partial(errors_figure, result), "Dotted: another trace."),
                ]),
                Section("How it was computed", ["A note."], detail=True),     # pages only
            ],
            data=as_data(result),
        )

Then every command shows it alike: ``@output_options(page=True)`` gives it an ``output``, and ``output.show(report_of(
result))`` prints and writes what was asked for (:mod:`ambient_trainer.cli.options`, :mod:`ambient_trainer.cli.output`).

- The **terminal** (:mod:`.terminal`) prints the title, findings and tables, in their order; facts, notes (a ``str``
  among the blocks), figures and sections with ``detail`` are left out.
- The **machine** (:mod:`.files`) gets ``data``, and nothing else: keys are a contract.
- The **page** (:mod:`.page`) has everything, by one template. It escapes all text, writes ``degC`` as °C and what
  stands between backquotes as code, numbers the plots, and turns dark where the reader's screen is.

How to test it: a file ``sample_report.py`` among the package's tests with ``samples() -> dict[str, Report]``, made in a
moment; ``tests/ambient_trainer/report/test_pages.py`` finds it by its name and opens each in a browser, wide and
narrow, light and dark. The package's own tests look at the report's facts, not at HTML.

Plots: a :class:`Figure` holds a function without arguments (use :func:`functools.partial`) that returns a plotly
figure, made by :mod:`.plots`: :func:`.plots.stacked_figure` of panels over time, :func:`.plots.panel_figure` with
:func:`.plots.add_curve`, :func:`.plots.matrix_figure`. Only a page calls it, so ``plots`` may be imported anywhere, and
plotly at the top of no module. Colours come from :mod:`.palette`, by what they stand for; no other module names one,
because each needs a counterpart on a dark page.
"""

from typing import TYPE_CHECKING

from ambient_trainer.report.structure import Block, Facts, Figure, Finding, Plot, Report, Section, Status, Table

if TYPE_CHECKING:
    from ambient_trainer.report import palette, plots  # numpy: commands should not wait for it
