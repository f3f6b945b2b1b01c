"""What a call refuses, as every reader of files does: all faults at once, each with its place."""

from collections.abc import Callable
from typing import Any

import pytest

from ambient_model.faults import Refused


def refused(call: Callable[..., Any], *args: Any, **named: Any) -> Refused:
    """The refusal that a call ends with."""
    with pytest.raises(Refused) as raised:
        call(*args, **named)
    return raised.value


def refused_places(call: Callable[..., Any], *args: Any, **named: Any) -> list[str]:
    """The place of each fault that a call names, in their order."""
    return [fault.place for fault in refused(call, *args, **named).faults]
