"""With the byte code of the building Python the one file says the same, and another Python takes the sources."""

import importlib.util
import subprocess
import sys
import zipfile

import pytest


@pytest.fixture
def compiled(build, tmp_path):
    path = tmp_path / "compiled.pyz"
    assert build("build_zipapp.py", "-o", path, "--compiled").returncode == 0
    return path


def said(path, model_file):
    words = [sys.executable, "-I", "-S", str(path), "check", "--model", model_file]
    done = subprocess.run(words, capture_output=True, text=True, timeout=30, env={})
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_each_module_has_its_byte_code_beside_it(compiled, zipapp):
    with zipfile.ZipFile(compiled) as full, zipfile.ZipFile(zipapp) as plain:
        modules = {name for name in plain.namelist() if name.endswith(".py")}
        assert set(full.namelist()) == {*plain.namelist(), *(f"{name}c" for name in modules)}
        assert all(full.read(name) == plain.read(name) for name in plain.namelist())


def test_it_says_the_same_from_the_byte_code(compiled, zipapp, model_file):
    ask = "import sys; sys.path[:0] = sys.argv[1:]; import ambientd.cli as cli; print(cli.call.__doc__)"
    words = [sys.executable, "-I", "-S", "-c", ask, str(compiled)]
    loaded = subprocess.run(words, capture_output=True, text=True, timeout=30, env={}, check=True).stdout
    assert loaded == "None\n", "the sources have docstrings, the byte code has none"
    assert said(compiled, model_file) == said(zipapp, model_file)


def test_the_byte_code_of_another_python_is_passed_by(compiled, zipapp, model_file, tmp_path):
    other = tmp_path / "other.pyz"
    with zipfile.ZipFile(compiled) as full, zipfile.ZipFile(other, "w") as changed:
        for name in full.namelist():
            content = full.read(name)
            if name.endswith(".pyc"):
                assert content.startswith(importlib.util.MAGIC_NUMBER)
                content = b"\x01\x00\r\n" + content[4:]
            changed.writestr(name, content)
    assert said(other, model_file) == said(zipapp, model_file)
