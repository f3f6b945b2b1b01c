"""One file that needs nothing but an interpreter: built twice alike, and of the same opinion as the packages."""

import os
import stat
import sys
import zipfile
from pathlib import Path

import pytest

from processes import ran

ROOT = Path(__file__).resolve().parents[2]


def run(words, **options):
    return ran(*words, **{"env": {}, **options})


@pytest.mark.parametrize(
    ("script", "more"),
    [("build_zipapp.py", []), ("build_magisk.py", []), ("build_deb.py", ["--maintainer", "Jane <jane@example.com>"])],
)
def test_two_builds_are_the_same_bytes_whatever_the_clock_the_mask_and_the_folder(build, tmp_path, script, more):
    built = [tmp_path / "one", tmp_path / "deep" / "er"]
    built[1].parent.mkdir()
    for path, mask in zip(built, (0o022, 0o077)):
        before = os.umask(mask)
        try:
            printed = build(script, "-o", path, *more)
        finally:
            os.umask(before)
        assert printed == f"{path}: {path.stat().st_size} bytes\n"
    assert built[0].read_bytes() == built[1].read_bytes()
    assert os.listdir(built[1].parent) == ["er"]


def test_it_holds_the_daemon_and_the_model_and_nothing_else(zipapp):
    with zipfile.ZipFile(zipapp) as archive:
        assert archive.testzip() is None
        names = archive.namelist()
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert names == sorted(names)
    assert {name.split("/")[0] for name in names} == {"LICENSE", "__main__.py", "ambient_model", "ambientd"}
    on_disk = {
        str(path.relative_to(folder)) for folder in (ROOT / "shared", ROOT / "daemon") for path in folder.rglob("*.py")
    }
    assert set(names) - {"LICENSE", "__main__.py"} == on_disk


def test_a_yaml_configuration_is_refused_with_the_way_out(deployed, write, model_file):
    done = run(deployed("run", "--config", write("ambientd.yaml", f"model: {model_file}\n")), status=1)
    assert "or write the same keys as JSON into a file that ends with .json" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_file_runs_by_its_own_name(build, tmp_path, model_file):
    """The first line isolates the interpreter: a module of the same name in PYTHONPATH does not get in."""
    python = os.path.realpath(sys.executable)
    path = tmp_path / "ambientd.pyz"
    build("build_zipapp.py", "-o", path, "--python", python)
    assert stat.S_IMODE(path.stat().st_mode) & 0o111 == 0o111
    assert path.read_bytes().splitlines()[0] == f"#!{python} -IS".encode()
    (tmp_path / "json.py").write_text("raise SystemExit('not isolated')")
    done = run([str(path), "check", "--model", str(model_file)], env={"PYTHONPATH": str(tmp_path)}, cwd=tmp_path)
    assert done.stderr == ""


def checked(path, model_file):
    done = run([sys.executable, "-I", "-S", str(path), "check", "--model", model_file])
    assert done.stderr == ""
    return done.stdout


def test_it_says_the_same_from_the_byte_code(build, tmp_path, zipapp, model_file):
    compiled = tmp_path / "compiled.pyz"
    build("build_zipapp.py", "-o", compiled, "--compiled")
    ask = "import sys; sys.path[:0] = sys.argv[1:]; import ambientd.cli as cli; print(cli.call.__doc__)"
    words = [sys.executable, "-I", "-S", "-c", ask, str(compiled)]
    assert run(words).stdout == "None\n", "the sources have docstrings, the byte code has none"
    assert checked(compiled, model_file) == checked(zipapp, model_file)
