"""Documents for properties: anything that JSON holds, and any value of a document replaced by another."""

import copy
import functools
from collections.abc import Iterator
from typing import Any

from hypothesis import strategies as st

Way = tuple[str | int, ...]


def anything(*more: st.SearchStrategy[Any], size: int = 4, **of_floats: bool) -> st.SearchStrategy[Any]:
    """Values of any kind, lists and mappings of them, and ``more``."""
    numbers = st.integers() | st.floats(**of_floats)
    return st.recursive(
        st.one_of(st.none(), st.booleans(), numbers, st.text(max_size=5), *more),
        lambda inner: st.lists(inner, max_size=size) | st.dictionaries(st.text(max_size=5), inner, max_size=size),
        max_leaves=8,
    )


def ways(document: Any, way: Way = ()) -> Iterator[Way]:
    """The path of every value in a document."""
    if way:
        yield way
    if isinstance(document, dict | list):
        for key, value in document.items() if isinstance(document, dict) else enumerate(document):
            yield from ways(value, (*way, key))


def at(document: Any, way: Way) -> Any:
    """The value at a path."""
    return functools.reduce(lambda place, step: place[step], way, document)


def with_value(document: Any, *way: str | int, value: Any) -> Any:
    """A copy of a document with another value at one place."""
    changed = copy.deepcopy(document)
    at(changed, way[:-1])[way[-1]] = value
    return changed


@st.composite
def damaged(draw: st.DrawFn, document: Any, values: st.SearchStrategy[Any] = anything()) -> Any:  # noqa: B008
    """A copy of a document with one to three of its values, at any depth, replaced."""
    for _ in range(draw(st.integers(1, 3))):
        document = with_value(document, *draw(st.sampled_from(list(ways(document)))), value=draw(values))
    return document
