"""Files to import: written by the test, or measured and kept beside the repository."""

from collections.abc import Callable

import pytest


@pytest.fixture
def write(tmp_path) -> Callable[[str, str], str]:
    def written(name: str, text: str) -> str:
        (tmp_path / name).write_text(text, encoding="utf-8", newline="")
        return str(tmp_path / name)

    return written
