import ast
import re
from pathlib import Path

import pytest

TOP_LEVEL = {"pyproject.toml", "daemon", "trainer", "shared", "tests", "deploy", "README.md", "LICENSE", "CHANGELOG.md"}
SOMEBODYS_FOLDER = re.compile(r"(?<![\w.})>-])/(?:work|root|home)/")
REGISTRIES = [
    ".".join(host)
    for host in (("pypi", "org"), ("pythonhosted", "org"), ("npmjs", "com"), ("npmjs", "org"), ("debian", "org"))
]


def test_the_top_level_holds_the_house_and_nothing_else(tracked: list[Path]) -> None:
    strangers = {path.parts[0] for path in tracked if not path.parts[0].startswith(".")} - TOP_LEVEL
    assert strangers == set()


def test_every_module_opens_with_the_rule_it_owns(sources) -> None:
    silent = [
        str(path.relative_to(sources.root))
        for trees in sources.trees.values()
        for path, tree in trees.items()
        if not ast.get_docstring(tree)
    ]
    assert silent == []


def lines_of(root: Path, tracked: list[Path]) -> list[tuple[str, str]]:
    """Every line of every tracked text file, with its place."""
    lines = []
    for name in tracked:
        path = root / name
        if path.is_file():
            try:
                text = path.read_text(encoding="utf-8")
            except UnicodeDecodeError:
                continue  # not text
            lines.extend((f"{name}:{number}", line) for number, line in enumerate(text.splitlines(), 1))
    return lines


def test_no_file_names_somebodys_folder(sources, tracked: list[Path]) -> None:
    found = [place for place, line in lines_of(sources.root, tracked) if SOMEBODYS_FOLDER.search(line)]
    assert found == [], "an absolute path into one person's machine helps nobody else"


def test_no_file_names_a_package_registry(sources, tracked: list[Path]) -> None:
    found = [place for place, line in lines_of(sources.root, tracked) if any(host in line for host in REGISTRIES)]
    assert found == [], "where packages come from is the business of whoever installs them"


@pytest.mark.parametrize("prefix", ["", '"', "(", "= ", "file://"])
def test_the_search_finds_a_folder(prefix: str) -> None:
    folder = "/".join(["", "home", "someone", "trace.csv"])
    assert SOMEBODYS_FOLDER.search(prefix + folder)
    assert not SOMEBODYS_FOLDER.search("deploy" + folder)


def test_the_device_part_depends_on_nothing(sources) -> None:
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    project = tomllib.loads((sources.root / "pyproject.toml").read_text())["project"]
    assert project["dependencies"] == []
    assert set(project["optional-dependencies"]) >= {"yaml", "trainer"}
    assert project["scripts"].keys() == {"ambientd", "ambient-trainer"}
