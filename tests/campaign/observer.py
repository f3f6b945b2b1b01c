"""A consumer that does nothing but look: ``observer.py FOLDER``; what it saw that may not be goes to standard output.

The daemon says the number of the row in each of ``temp`` (renamed), ``same`` (in place) and ``status``. Each look asks
the status first: what the files say may then be newer, never older. What is written in place it takes when it has read
the same twice: two reads may meet one write. It ends when ``stop`` is in the folder.
"""

import json
import os
import re
import sys
from collections.abc import Callable


def number_in(content: bytes) -> int:
    """What a consumer makes of a published file, which is whole or a fault."""
    if not re.fullmatch(rb"-?[0-9]{1,13}\n+", content) or len(content) > 15:
        raise ValueError(f"torn or empty: {content!r}")
    return int(content)


def content_of(path: str) -> bytes:
    with open(path, "rb") as stream:
        return stream.read()


def twice(read: Callable[[], bytes]) -> bytes:
    content = read()
    while content != (again := read()):
        content = again
    return content


def look(folder: str, kept: int) -> None:
    report = json.loads(content_of(f"{folder}/status"))
    said = round(report["ambient_degC"] * 1000)
    if said != report["time_s"]:
        raise ValueError(f"the status of {report['time_s']} says {said}")
    contents = {
        "temp": content_of(f"{folder}/temp"),
        "same": twice(lambda: content_of(f"{folder}/same")),
        "same, kept open": twice(lambda: os.pread(kept, 32, 0)),
    }
    for name, content in contents.items():
        if number_in(content) < said:
            raise ValueError(f"{name} says {content!r} after the status said {said}")


def main(folder: str) -> None:
    while not all(os.path.exists(f"{folder}/{name}") for name in ("temp", "same", "status")):
        pass
    kept = os.open(f"{folder}/same", os.O_RDONLY)
    looks, faults = 0, []
    while not os.path.exists(f"{folder}/stop"):
        looks += 1
        try:
            look(folder, kept)
        except (ValueError, OSError) as fault:
            faults.append(str(fault))
    print(json.dumps({"looks": looks, "faults": faults}))


if __name__ == "__main__":
    main(sys.argv[1])
