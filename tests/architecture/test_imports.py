import sys

import pytest

from processes import ran

HEAVY = {"asyncio", "dataclasses", "logging", "pathlib", "subprocess", "tempfile"}
COST = "on the device every import costs start-up time and memory (asyncio 10 MB, dataclasses 27 ms): do without"
FOREIGN = (
    *("numpy", "scipy", "yaml", "serial", "pydantic", "click"),
    *("rich", "jinja2", "plotly", "threadpoolctl", "sklearn", "joblib"),
)
CONFIG = ("daemon/ambientd/config.py", "daemon/ambientd/config/")


def test_there_is_something_to_look_at(sources) -> None:
    for package in sources.trees:
        assert len(sources.modules(package)) > 5
        assert sources.imports(package)


@pytest.mark.parametrize(
    ("package", "others"), [("ambient_model", ()), ("ambientd", ("ambient_model", "yaml", "paho"))]
)
def test_what_the_device_needs_beside_the_standard_library(sources, package: str, others: tuple[str, ...]) -> None:
    allowed = {package, *others, *sys.stdlib_module_names}
    imports = sources.imports(package)
    assert [str(each) for each in imports if each.top not in allowed] == []
    assert [str(each) for each in imports if each.top in HEAVY] == [], COST


def test_yaml_is_imported_late_and_by_the_configuration_alone(sources) -> None:
    found = [each for each in sources.imports("ambientd") if each.top == "yaml"]
    wrong = [str(each) for each in found if not each.in_function or not each.importer.startswith(CONFIG)]
    assert wrong == [], "a device with a JSON configuration has no PyYAML, and does not pay for it"


IMPORT_ALL = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {foreign!r}:
            raise ImportError("blocked: " + name)

sys.meta_path.insert(0, Blocker())
sys.path[:0] = {path!r}
before = set(sys.modules)
for name in {modules!r}:
    __import__(name)
print(*sorted(set(sys.modules) - before), sep="\\n")
"""


@pytest.mark.parametrize("packages", [("ambient_model",), ("ambient_model", "ambientd")])
def test_a_bare_interpreter_imports_every_module_of_the_device(sources, packages: tuple[str, ...]) -> None:
    """Without site-packages and the libraries of the host."""
    script = IMPORT_ALL.format(
        foreign=FOREIGN,
        path=[str(sources.root / "shared"), str(sources.root / "daemon")],
        modules=[name for package in packages for name in sources.modules(package) if not name.endswith("__main__")],
    )
    loaded = set(ran(sys.executable, "-I", "-S", "-c", script).stdout.split())
    assert {name.partition(".")[0] for name in loaded} >= set(packages)
    assert loaded & {*HEAVY, *FOREIGN} == set(), COST
