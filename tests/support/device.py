"""A fake sysfs of real files."""

from collections.abc import Mapping
from pathlib import Path


def write_files(folder: Path, files: Mapping[str, str]) -> Path:
    """A folder with files of these names and contents."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_text(content)
    return folder


def add_zone(sysfs: Path, number: int, kind: str, temp: str | None = None) -> Path:
    """A thermal zone's folder; a zone is written in place, as a kernel attribute appears to be."""
    folder = sysfs / "class" / "thermal" / f"thermal_zone{number}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "type").write_text(f"{kind}\n")
    if temp is not None:
        (folder / "temp").write_text(temp)
    return folder
