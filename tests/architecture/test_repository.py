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
    assert {path.parts[0] for path in tracked if not path.parts[0].startswith(".")} - TOP_LEVEL == set()


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


def test_no_file_names_somebodys_folder_or_a_package_registry(sources, tracked: list[Path]) -> None:
    lines = lines_of(sources.root, tracked)
    found = [place for place, line in lines if SOMEBODYS_FOLDER.search(line)]
    assert found == [], "an absolute path into one person's machine helps nobody else"
    found = [place for place, line in lines if any(host in line for host in REGISTRIES)]
    assert found == [], "where packages come from is the business of whoever installs them"


def test_the_device_part_depends_on_nothing(sources) -> None:
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    project = tomllib.loads((sources.root / "pyproject.toml").read_text())["project"]
    assert project["dependencies"] == []
    assert set(project["optional-dependencies"]) >= {"yaml", "trainer"}
    assert project["scripts"].keys() == {"ambientd", "ambientd-mqtt", "ambient-trainer"}


def test_each_top_folder_explains_itself(tracked: list[Path]) -> None:
    folders = {path.parts[0] for path in tracked if len(path.parts) > 1 and not path.parts[0].startswith(".")}
    assert [folder for folder in sorted(folders) if Path(folder, "README.md") not in tracked] == []


def test_each_package_is_typed(sources, tracked: list[Path]) -> None:
    packages = {path.parent for path in tracked if path.name == "__init__.py" and len(path.parts) == 3}
    assert {path.name for path in packages} == set(sources.trees)
    assert [path for path in packages if path / "py.typed" not in tracked] == []


# Private words, each as a pattern, and the field's word for it. The field's own uses are exempt: "limit" of a range,
# "cost" of a computation, "bank" of filters, "unit" of a quantity, "search" and "forward" as such, "at rest" of water.
PRIVATE_WORDS = {
    r"taught|teach(es|ing)?|lessons?|classroom": "trained, fit, sample, training set",
    r"made[- ]up": "synthetic",
    r"believ(e|es|ed|able)": "prior, plausible",
    r"guard(s|ed)?": "secondary estimator",
    r"has a say|(has the )?last word": "blended, takes precedence",
    r"voices?|speaks?|speaking": "active estimator",
    r"unrest": "rate of change",
    r"spreads?": "error variance model",
    r"told|tells?": "report, summary",
    r"mends?": "hint, remedy",
    r"walking ambient": "random-walk ambient",
    r"nobody logs": "unmeasured heat",
    r"deaf to": "insensitive to",
    r"moving along": "re-optimised",
}
CONTRACTS = re.compile(
    r"""["'`]+(guard(_above|_below)?|spread|unrest|voices|speaking|lag_guard)["'`]+|["'](guard|spread)\.[^"']*["']"""
    r"""|f?["']spread\.terms[^"']*["']|guard(_above|_below)? +=|is 'guard'|key 'guard'"""
    r"""|"told" if name|ambientd tell|["']tell["']|STATE\.tell|\.tell["']"""
)
"""Keys of files and names of commands, which stay: the model's ``guard`` and ``spread``, ``ambientd tell``."""


@pytest.mark.parametrize("package", ["ambient_model", "ambientd", "ambient_trainer", "ambient_studies"])
def test_product_code_uses_the_fields_words(sources, package: str) -> None:
    words = re.compile(rf"(?<![a-zA-Z])({'|'.join(PRIVATE_WORDS)})(?![a-zA-Z])", re.IGNORECASE)
    found = [
        f"{path.relative_to(sources.root)}:{number}: {hit[0]}"
        for path in sources.trees[package]
        if path.relative_to(sources.root).parts[2:3] != ("laboratory",)  # its guard is a process that guards a chamber
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        for hit in words.finditer(CONTRACTS.sub("", line))
    ]
    assert found == []
