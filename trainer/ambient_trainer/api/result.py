"""What every result of the API offers: a file, its report as a page, and its tables in a notebook."""

import html
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence

from ambient_trainer.report import Block, Finding, Report, Section, Table
from ambient_trainer.report.files import write_json


class Result(ABC):
    """A result with a report."""

    @property
    @abstractmethod
    def summary(self) -> Report:
        """Facts, findings, tables and figures: what the command of the same name shows."""

    def save(self, path: str | os.PathLike[str]) -> str:
        """Write the result: a fit's model file, a run's trace, else JSON as the command's ``--json`` does.

        Parameters
        ----------
        path : str or path
            The file; of a trace, ``.gz`` compresses it.

        Returns
        -------
        str
            The same path.

        Raises
        ------
        Refused
            For a fit whose circuit does not estimate the ambient.
        """
        self._write(os.fspath(path))
        return os.fspath(path)

    def _write(self, path: str) -> None:
        write_json(path, self.summary.data)

    def report(self, folder: str | os.PathLike[str]) -> str:
        """Write a page with plots.

        Parameters
        ----------
        folder : str or path
            Where ``index.html`` and its script go; made where missing.

        Returns
        -------
        str
            The path of the page.

        Raises
        ------
        Refused
            Where the folder cannot be written to.
        """
        from ambient_trainer.report.page import write_report  # plotly and jinja2: only a page should wait for them

        return write_report(os.fspath(folder), self.summary)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.summary.title}>"  # not the fields: they hold every sample

    def _repr_html_(self) -> str:
        """Title, findings and tables, for a notebook."""
        summary = self.summary
        return f"<h4>{html.escape(summary.title)}</h4>{''.join(_html([*summary.lead, *summary.sections]))}"


def _html(blocks: Sequence[Block | None]) -> Iterator[str]:
    for each in blocks:
        if isinstance(each, Finding):
            text = " ".join(filter(None, (each.label, each.value, each.text)))
            yield f"<p>{html.escape(text)}</p>"
        elif isinstance(each, Table):
            rows = ["".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in each.rows]
            head = "".join(f"<th>{html.escape(column)}</th>" for column in each.columns)
            body = "".join(f"<tr>{row}</tr>" for row in rows)
            yield f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        elif isinstance(each, Section) and not each.detail:
            yield from _html(each.blocks)
