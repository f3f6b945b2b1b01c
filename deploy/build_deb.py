#!/usr/bin/env python3
"""The daemon as a Debian package: the same bytes from the same sources, by the standard library.

A package is an ar archive of two compressed tar archives. Times are fixed, the order is sorted, and everything belongs
to root; only another release of liblzma or zlib makes other bytes. The interpreter is isolated, but finds Debian's
PyYAML, and the shipped unit and configuration go in as they are.
"""

import argparse
import gzip
import io
import lzma
import os
import posixpath
import sys
import tarfile
import textwrap
import time
from pathlib import Path

from build_zipapp import ROOT, put, version, zipapp

DEPLOY = ROOT / "deploy"
MAINTAINER = "whoever built it <root@localhost>"
_TIME_S = 1767225600
"""2026-01-01: fixed, so that two builds are the same; the variable SOURCE_DATE_EPOCH replaces it."""
_SCRIPTS = ("postinst", "prerm", "postrm")
_DOC = "usr/share/doc/ambientd"
_EXAMPLES = ("thermald/ambientd.conf", "thermald/thermal-conf.xml")


def installed(maintainer: str) -> dict[str, tuple[bytes, int]]:
    """What the package puts into the system: content and mode by path."""
    files = {
        "etc/ambientd/ambientd.yaml": (DEPLOY / "ambientd.yaml").read_bytes(),
        "usr/lib/systemd/system/ambientd.service": (DEPLOY / "ambientd.service").read_bytes(),
        "usr/lib/sysusers.d/ambientd.conf": (DEPLOY / "sysusers.d" / "ambientd.conf").read_bytes(),
        f"{_DOC}/README.md": (DEPLOY / "README.md").read_bytes(),
        f"{_DOC}/copyright": (ROOT / "LICENSE").read_bytes(),
        f"{_DOC}/changelog.gz": _gzip(changelog(maintainer)),
        "usr/share/man/man1/ambientd.1.gz": _gzip((DEPLOY / "debian" / "ambientd.1").read_text(encoding="utf-8")),
        **{f"{_DOC}/examples/{name}": (DEPLOY / name).read_bytes() for name in _EXAMPLES},
    }
    program = {"usr/bin/ambientd": (zipapp(options="-I"), 0o755)}
    return {**{path: (content, 0o644) for path, content in files.items()}, **program}


def _time_s() -> int:
    return int(os.environ.get("SOURCE_DATE_EPOCH", _TIME_S))


def _gzip(text: str) -> bytes:
    return gzip.compress(text.encode(), 9, mtime=0)


def changelog(maintainer: str) -> str:
    """The newest section of the changelog in Debian's form."""
    section = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").partition("\n## ")[2].partition("\n## ")[0]
    lines = []
    for item in f"\n{section}".split("\n- ")[1:]:
        text = item.partition("\n\n")[0]
        lines.append(textwrap.fill(text, 78, initial_indent="  * ", subsequent_indent="    ", break_on_hyphens=False))
    date = time.strftime("%a, %d %b %Y %H:%M:%S +0000", time.gmtime(_time_s()))
    return "\n".join(
        [f"ambientd ({version()}) unstable; urgency=medium", "", *lines, "", f" -- {maintainer}  {date}", ""]
    )


def package(maintainer: str) -> bytes:
    """The .deb."""
    files = installed(maintainer)
    kib = sum(-(-len(content) // 1024) for content, _ in files.values())
    control = (DEPLOY / "debian" / "control").read_text(encoding="utf-8")
    for name, value in (("@VERSION@", version()), ("@MAINTAINER@", maintainer), ("@KIB@", str(kib))):
        control = control.replace(name, value)
    kept = "".join(f"/{path}\n" for path in sorted(files) if path.startswith("etc/"))
    about = {"control": (control.encode(), 0o644), "conffiles": (kept.encode(), 0o644)}
    about.update({name: ((DEPLOY / "debian" / name).read_bytes(), 0o755) for name in _SCRIPTS})
    members = (("debian-binary", b"2.0\n"), ("control.tar.xz", _tar(about)), ("data.tar.xz", _tar(files)))
    return b"!<arch>\n" + b"".join(_member(name, content) for name, content in members)


def _tar(files: dict[str, tuple[bytes, int]]) -> bytes:
    """The files and the folders that they lie in, from ./ on, compressed."""
    folders = {"."}
    for path in files:
        while path := posixpath.dirname(path):
            folders.add(f"./{path}")
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.GNU_FORMAT) as archive:
        for folder in sorted(folders):
            archive.addfile(_entry(folder, 0o755, tarfile.DIRTYPE))
        for path, (content, mode) in sorted(files.items()):
            entry = _entry(f"./{path}", mode, tarfile.REGTYPE)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    return lzma.compress(stream.getvalue(), check=lzma.CHECK_CRC32, preset=9)


def _entry(name: str, mode: int, kind: bytes) -> tarfile.TarInfo:
    entry = tarfile.TarInfo(name)
    entry.mode, entry.type, entry.uname, entry.gname = mode, kind, "root", "root"
    entry.mtime = _time_s()
    return entry


def _member(name: str, content: bytes) -> bytes:
    """One file of an ar archive, at an even length."""
    header = f"{name:<16}{_time_s():<12}{0:<6}{0:<6}{0o100644:<8o}{len(content):<10}`\n"
    return header.encode() + content + b"\n" * (len(content) % 2)


def main() -> int:
    """Run the command line; returns its exit status."""
    parser = argparse.ArgumentParser(description="Build the Debian package.")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="(default: ambientd_VERSION_all.deb)")
    parser.add_argument("--maintainer", metavar="'NAME <ADDRESS>'", default=MAINTAINER)
    options = parser.parse_args()
    if not options.maintainer.isprintable() or not options.maintainer.endswith(">"):
        parser.error(f"argument --maintainer: {options.maintainer!r} is not such as 'Jane Doe <jane@example.com>'")
    try:
        put(options.output or Path(f"ambientd_{version()}_all.deb"), package(options.maintainer), 0o644)
    except (OSError, ValueError) as error:
        print(f"build_deb: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
