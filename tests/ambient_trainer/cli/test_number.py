"""Options that take a number refuse what is none before any work."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from ambient_trainer.cli.main import trainer

CALLS = [
    ("diagnose x.csv --circuit phone --period", "nan"),
    ("fit x.csv --circuit phone -o x.json --period", "inf"),
    ("identifiability x.csv --circuit phone --period", "nan"),
    ("simulate 5 -o x.csv --period", "nan"),
    ("mitigate x.json --limit", "nan"),
]


@pytest.mark.parametrize(("call", "number"), CALLS)
def test_what_is_not_finite_is_refused(call: str, number: str) -> None:
    done = CliRunner().invoke(trainer, [*call.split(), number])
    assert done.exit_code == 2
    option = call.split()[-1]
    assert f"Invalid value for '{option}': {number} is not a finite number." in done.output
