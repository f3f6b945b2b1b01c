"""node_exporter: the text files in Debian's folder, which may be links."""

import os

from ambientd.consumers import Reading

_FOLDER = "var/lib/prometheus/node-exporter"


def reads(root: str) -> list[Reading]:
    """Each text file there; only a link is of a configuration, the others are of any program."""
    folder = os.path.join(root, _FOLDER)
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return []
    paths = [os.path.join(folder, name) for name in names if name.endswith(".prom")]
    return [Reading(path, "prometheus", is_named=os.path.islink(path)) for path in paths]
