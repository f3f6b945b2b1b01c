#!/usr/bin/env python3
"""The daemon as a Magisk module: a zip to be installed by Magisk, the same bytes from the same sources."""

import argparse
import io
import re
import sys
from pathlib import Path

from build_zipapp import ROOT, put, version, write_archive, zipapp

MODULE = ROOT / "deploy" / "magisk"
_SCRIPTS = ("service.sh", "customize.sh", "META-INF/com/google/android/update-binary")


def module() -> bytes:
    """The zip."""
    files = {path.relative_to(MODULE).as_posix(): path.read_bytes() for path in MODULE.rglob("*") if path.is_file()}
    files["module.prop"] = _stamped(files["module.prop"].decode()).encode()
    files["ambientd.pyz"] = zipapp()
    files["ambientd.json"] = (ROOT / "deploy" / "android" / "ambientd.json").read_bytes()
    stream = io.BytesIO()
    write_archive(stream, files, frozenset(_SCRIPTS))
    return stream.getvalue()


def _stamped(properties: str) -> str:
    """``properties`` with the version, and the number that Magisk compares, in their places."""
    found = version()
    major, minor, patch = [int(digits) for digits in re.findall(r"\d+", found)[:3]]
    return properties.replace("@VERSION@", found).replace("@CODE@", str((major * 1000 + minor) * 1000 + patch))


def main() -> int:
    """Run the command line; returns its exit status."""
    parser = argparse.ArgumentParser(description="Build the Magisk module.")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, default=Path("ambientd-magisk.zip"))
    options = parser.parse_args()
    try:
        put(options.output, module(), 0o644)
    except (OSError, ValueError) as error:
        print(f"build_magisk: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
