"""JSON is written without the module ``json``, which takes 1.2 MB of a process of 10 MB; what is read needs it."""

from typing import Any

try:  # the function of the interpreter that ``json`` itself uses
    from _json import encode_basestring_ascii as quoted
except ImportError:
    from json.encoder import encode_basestring_ascii as quoted

__all__ = ["json_text", "quoted"]
_NUMBERS = frozenset((float, int))


def json_text(value: Any) -> str:
    """``value`` (mappings, lists, tuples, texts, finite numbers, truth values, None) as ``json.dumps`` writes it."""
    if type(value) is float:
        return repr(value)
    if isinstance(value, (list, tuple)):
        if _NUMBERS.issuperset(map(type, value)):
            return repr([*value])
        return f"[{', '.join([json_text(each) for each in value])}]"
    if value is None:
        return "null"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    return f"{{{', '.join([f'{quoted(key)}: {json_text(each)}' for key, each in value.items()])}}}"
