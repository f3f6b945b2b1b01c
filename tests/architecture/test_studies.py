"""The product works without the studies and knows nothing of them; the studies use what packages export."""

import ast
import importlib
import sys
from pathlib import Path

import pytest

from processes import ran

WITHOUT = """
import sys
class Gone:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "ambient_studies":
            raise ModuleNotFoundError(name)
import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name == "ambient_studies" else found(name, package)
sys.meta_path.insert(0, Gone())
sys.argv = ["ambient-trainer", *sys.argv[1:]]
from ambient_trainer.__main__ import main
main()
"""
EXPORTING = (
    "circuits", "cli", "data", "diagnosis", "estimation", "estimators", "evaluation", "lti", "report", "simulator",
)  # fmt: skip
"""Packages of which the studies import exported names only."""


def _run(*arguments: object, status: int = 0) -> str:
    return ran(sys.executable, "-c", WITHOUT, *arguments, status=status, timeout=220).stdout


def test_the_product_works_without_the_studies(tmp_path: Path) -> None:
    shown = _run("--help")
    assert "Studies" not in shown
    assert "fit" in shown
    _run("reproduce", status=2)
    trace, model = tmp_path / "trace.csv", tmp_path / "model.json"
    trace.write_text("time_s,usb_degC,ambient_degC\n" + "".join(f"{k},{20 + k % 7},{18 + k % 5}\n" for k in range(60)))
    _run("fit", trace, "--circuit", "linear_usb", "-o", model)
    assert model.exists()


@pytest.mark.parametrize("package", EXPORTING)
def test_the_studies_import_what_a_package_exports(sources, package: str) -> None:
    whole = f"ambient_trainer.{package}"
    exports = ast.walk(ast.parse(Path(str(importlib.import_module(whole).__file__)).read_text()))
    public = [each.asname or each.name for node in exports if isinstance(node, ast.ImportFrom) for each in node.names]
    used = [each for each in sources.imports("ambient_studies") if f"{each.imported}.".startswith(f"{whole}.")]
    assert used
    assert [str(each) for each in used if each.imported != whole or each.name not in public] == []
