"""``ambientd watch``: what a running daemon says on its socket, for people."""

import json
import socket
from typing import Any

from ambient_model.faults import refuse
from ambientd.notices import say


def watch(path: str) -> None:
    """Print one line a tick until the daemon ends or the user does; raises :class:`Refused` where no one listens."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        try:
            connection.connect(path)
        except OSError as error:
            raise refuse(
                path,
                "",
                f"no daemon listens there ({error.strerror or error})",
                f"start one with 'ambientd run ... --publish socket:{path}'",
            ) from error
        try:
            with connection.makefile("r", encoding="utf-8") as lines:
                for line in lines:
                    print(as_text(json.loads(line)), flush=True)
        except KeyboardInterrupt:
            return
        except (ConnectionResetError, json.JSONDecodeError):
            pass  # it ended in the middle of a line
    say(f"{path}: the daemon has ended")


def as_text(report: dict[str, Any]) -> str:
    """One line for people from one report."""
    if report["ambient_degC"] is None:
        ambient = "no estimate"
    else:
        ambient = (
            f"{report['ambient_degC']:.2f} degC"
            f" ({report['low_degC']:.2f} to {report['high_degC']:.2f}, {report['level_percent']} %)"
        )
    sensors = "  ".join(f"{name} {_value(each['raw'])}" for name, each in report["sensors"].items())
    return f"{report['time_s']:12.1f} s  {report['status']:<10}  {ambient}  {sensors}"


def _value(raw: float | None) -> str:
    return "missing" if raw is None else f"{raw:.2f}"
