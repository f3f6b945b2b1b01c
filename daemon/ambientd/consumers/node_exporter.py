"""node_exporter: the text files in Debian's folder, which may be links."""

import os

from ambientd.consumers import Reading

_FOLDER = "var/lib/prometheus/node-exporter"


def reads(root: str) -> list[Reading]:
    """Each text file there."""
    folder = os.path.join(root, _FOLDER)
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return []
    return [Reading(os.path.join(folder, name), "prometheus") for name in names if name.endswith(".prom")]
