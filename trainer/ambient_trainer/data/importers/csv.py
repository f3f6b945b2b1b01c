"""Any text table, through a column map."""

from ambient_trainer.data.importers._column_map import parse_map
from ambient_trainer.data.importers._table import Imported, import_table
from ambient_trainer.data.strict_yaml import load_yaml

HELP = "any other table, through a map"
NEEDS_MAP = True


def import_file(path: str, map_path: str) -> Imported:
    """Trace that a column map makes of a text table; raises :class:`Refused`, with every fault of the map."""
    return import_table(path, parse_map(load_yaml(map_path), map_path), map_path)
