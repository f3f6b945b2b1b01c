"""Sockets that were made before the daemon: by Android's init or by systemd, which hand them over as descriptors.

Android's ``socket NAME stream 0660 USER GROUP`` in the ``.rc`` makes ``/dev/socket/NAME`` with its descriptor in
``ANDROID_SOCKET_NAME``; systemd's ``ListenStream=`` hands on descriptors from 3, ``LISTEN_FDS`` of them, to the
process ``LISTEN_PID``. A publication selects one by its path: ``socket:/dev/socket/NAME`` takes the
socket that is bound there, and makes one itself where none was handed over.
"""

import os
import socket
import stat
from collections.abc import Mapping

from ambient_model.faults import refuse

_ANDROID = "ANDROID_SOCKET_"
_FIRST_OF_SYSTEMD = 3
_MOST = 1024


def handed_over(environment: Mapping[str, str]) -> dict[str, int]:
    """The descriptor of each UNIX socket that was handed over, by the path to which it is bound."""
    sockets = {}
    for descriptor in _descriptors(environment):
        try:
            if stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                with socket.socket(fileno=os.dup(descriptor)) as handed:
                    name = handed.getsockname()
                    if handed.family == socket.AF_UNIX and isinstance(name, str) and name:
                        sockets[os.path.normpath(name)] = descriptor
        except OSError:
            continue
    return sockets


def _descriptors(environment: Mapping[str, str]) -> list[int]:
    found = [_number(value) for name, value in environment.items() if name.startswith(_ANDROID)]
    if _number(environment.get("LISTEN_PID", "")) == os.getpid():
        count = min(_number(environment.get("LISTEN_FDS", "")), _MOST)
        found.extend(range(_FIRST_OF_SYSTEMD, _FIRST_OF_SYSTEMD + count))
    return [each for each in found if each > 0]


def _number(text: str) -> int:
    return int(text) if text.isascii() and text.isdigit() and len(text) < 10 else -1


def listener_at(path: str, environment: Mapping[str, str]) -> socket.socket | None:
    """The listener that was handed over for ``path``, or None; raises :class:`~ambient_model.faults.Refused`.

    It is a copy: what was handed over stays open, so that a publication may go with a reload and come back.
    """
    descriptor = handed_over(environment).get(os.path.abspath(path))
    if descriptor is None:
        return None
    handed = socket.socket(fileno=os.dup(descriptor))
    if handed.type != socket.SOCK_STREAM:
        handed.close()
        raise refuse(
            path, "", "was handed over, and is no stream socket", "make it 'stream' in the .rc or .socket file"
        )
    return handed
