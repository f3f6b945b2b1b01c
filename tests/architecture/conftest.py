"""The sources as data: where they lie, what each module imports, which files are tracked."""

import ast
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "ambient_model": ROOT / "shared" / "ambient_model",
    "ambientd": ROOT / "daemon" / "ambientd",
    "ambient_trainer": ROOT / "trainer" / "ambient_trainer",
    "ambient_studies": ROOT / "trainer" / "ambient_studies",
}


class Import(NamedTuple):
    """One module named by an import statement, an ``import_module`` or an ``__import__``."""

    importer: str
    line: int
    imported: str
    name: str
    """What is taken from it; empty for all of it."""
    in_function: bool

    @property
    def top(self) -> str:
        """The package that the imported module belongs to."""
        return self.imported.partition(".")[0]

    def __str__(self) -> str:
        return f"{self.importer}:{self.line} imports {self.imported}"


class Sources:
    """The three packages, parsed."""

    def __init__(self) -> None:
        self.root = ROOT
        self.trees = {
            package: {path: ast.parse(path.read_bytes(), str(path)) for path in sorted(folder.rglob("*.py"))}
            for package, folder in PACKAGES.items()
        }

    def modules(self, package: str) -> list[str]:
        """The dotted names of all modules of ``package``."""
        names = []
        for path in self.trees[package]:
            inside = path.relative_to(PACKAGES[package]).with_suffix("").parts
            names.append(".".join([package, *(part for part in inside if part != "__init__")]))
        return names

    def imports(self, package: str) -> list[Import]:
        """Everything that the modules of ``package`` import, wherever it stands."""
        return [
            Import(str(path.relative_to(ROOT)), line, module or package, name, inside)
            for path, tree in self.trees[package].items()
            for line, module, name, inside in _imports(tree, False)
        ]


def _imports(node: ast.AST, in_function: bool) -> Iterator[tuple[int, str, str, bool]]:
    """Line, module, name and whether inside a function; an empty module is the package's own (a relative import)."""
    if isinstance(node, ast.Import):
        yield from ((node.lineno, each.name, "", in_function) for each in node.names)
    elif isinstance(node, ast.ImportFrom):
        module = "" if node.level else node.module or ""
        yield from ((node.lineno, module, each.name, in_function) for each in node.names)
    elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
        called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if called in ("import_module", "__import__"):
            yield node.lineno, str(node.args[0].value), "", in_function
    inside = in_function or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
    for child in ast.iter_child_nodes(node):
        yield from _imports(child, inside)


@pytest.fixture(scope="session")
def sources() -> Sources:
    return Sources()


@pytest.fixture(scope="session")
def tracked() -> list[Path]:
    """The files under version control, relative to the root."""
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout: which files are tracked is unknown")
    return [Path(name) for name in listed.stdout.decode().split("\0") if name]
