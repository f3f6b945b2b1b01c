#!/usr/bin/env python3
"""The daemon as one file that runs under ``python3 -I -S``: the same sources give the same bytes, on any machine.

The standard ``zipapp`` takes times, modes and order from the file system; here the times are fixed, the order is
sorted, and nothing is compressed, since that differs between builds of zlib.
"""

import argparse
import importlib.util
import io
import marshal
import os
import re
import stat
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = (ROOT / "shared" / "ambient_model", ROOT / "daemon" / "ambientd")
INTERPRETER = "/usr/bin/python3"
_MAIN = b"import sys\n\nfrom ambientd.__main__ import main\n\nsys.exit(main())\n"
_EARLIEST = (1980, 1, 1, 0, 0, 0)  # a zip knows no earlier time


def write_archive(stream: IO[bytes], files: Mapping[str, bytes], executable: frozenset[str] = frozenset()) -> None:
    """Write ``files``, by name, as a zip; those in ``executable`` may be run by everyone."""
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, _EARLIEST)
            entry.create_system = 3  # Unix, wherever this is built: only then the mode below counts
            entry.external_attr = (stat.S_IFREG | (0o755 if name in executable else 0o644)) << 16
            archive.writestr(entry, files[name])


def sources() -> dict[str, bytes]:
    """What goes into the file, by its name there."""
    files = {
        path.relative_to(package.parent).as_posix(): path.read_bytes()
        for package in PACKAGES
        for path in package.rglob("*.py")
    }
    return {**files, "__main__.py": _MAIN, "LICENSE": (ROOT / "LICENSE").read_bytes()}


def byte_code(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """What the Python that runs this makes of the modules in ``files``, to lie beside them in the archive.

    Without docstrings, and never checked against the source. Another Python passes it by and takes the source.
    """
    unchecked = (1).to_bytes(4, "little")
    return {
        f"{name}c": importlib.util.MAGIC_NUMBER
        + unchecked
        + importlib.util.source_hash(content)
        + marshal.dumps(compile(content, name, "exec", dont_inherit=True, optimize=2))
        for name, content in files.items()
        if name.endswith(".py")
    }


def version() -> str:
    """The version that the sources say; raises ValueError where that is not such as 1.2.3."""
    source = (ROOT / "shared" / "ambient_model" / "__init__.py").read_text(encoding="utf-8")
    found = re.search(r'^__version__ = "(\d+\.\d+\.\d+.*)"$', source, re.MULTILINE)
    if found is None:
        raise ValueError("shared/ambient_model/__init__.py says no version such as 1.2.3")
    return found[1]


def zipapp(interpreter: str = INTERPRETER, compiled: bool = False, options: str = "-IS") -> bytes:
    """The daemon as one file, run by ``interpreter`` with ``options``; ``compiled`` adds this Python's byte code."""
    files = sources()
    stream = io.BytesIO()
    # one word: the kernel hands all that follows the interpreter over as a single argument
    stream.write(f"#!{interpreter} {options}\n".encode())
    write_archive(stream, {**files, **byte_code(files)} if compiled else files)
    return stream.getvalue()


def put(target: Path, content: bytes, mode: int) -> None:
    """Put ``content`` at ``target``; raises OSError, and then leaves what was there."""
    part = target.with_name(f"{target.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content)
        part.chmod(mode)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)
    print(f"{target}: {len(content)} bytes")


def main() -> int:
    """Run the command line; returns its exit status."""
    parser = argparse.ArgumentParser(description="Build the daemon as one file that any Python 3.10 or newer runs.")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, default=Path("ambientd.pyz"))
    parser.add_argument("--python", metavar="PATH", default=INTERPRETER, help=f"what runs it (default: {INTERPRETER})")
    parser.add_argument(
        "--compiled",
        action="store_true",
        help="add the byte code of the Python that builds it: that version then starts in half the time, in 1 MB less",
    )
    options = parser.parse_args()
    if not options.python.startswith("/") or any(character.isspace() for character in options.python):
        parser.error(f"argument --python: {options.python!r} is no absolute path without spaces")
    try:
        put(options.output, zipapp(options.python, options.compiled), 0o755)
    except OSError as error:
        print(f"build_zipapp: {error.filename or options.output}: {error.strerror or error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
