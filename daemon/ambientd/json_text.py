"""JSON is written without the module ``json``, which takes 1.2 MB of a process of 10 MB; what is read needs it."""

from collections.abc import Mapping
from typing import Any

try:  # the function of the interpreter that ``json`` itself uses
    from _json import encode_basestring_ascii as quoted
except ImportError:
    from json.encoder import encode_basestring_ascii as quoted

__all__ = ["json_text", "quoted"]


def json_text(value: Any) -> str:
    """``value`` (mappings, sequences, texts, finite numbers, truth values, None) as ``json.dumps`` writes it."""
    if value is None:
        return "null"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, Mapping):
        return f"{{{', '.join([f'{quoted(key)}: {json_text(each)}' for key, each in value.items()])}}}"
    return f"[{', '.join([json_text(each) for each in value])}]"
