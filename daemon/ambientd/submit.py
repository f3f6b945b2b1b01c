"""``ambientd tell``: hand a reading of the ambient to the running daemon and print what came of it."""

import os
import time

from ambient_model.atomic import replacing
from ambient_model.faults import Refused, refuse
from ambient_model.intake import read_whole
from ambientd.publish.swap import remove
from ambientd.reference import LastReference, submission_path
from ambientd.settings import Settings
from ambientd.state import LARGEST_BYTES, decode

_PATIENCE_S = 5.0


def submit(settings: Settings, value_degC: float, sigma_degC: float | None) -> None:
    """Print whether the reading counts, and the offset then; raises :class:`Refused` where it does not count."""
    if settings.reference is None:
        raise refuse(settings.source, "reference", "missing: this daemon does not learn", "add 'reference: {}'; reload")
    if settings.state is None:
        raise refuse(settings.source, "state", "missing: what is learnt has no file", "add 'state: {path: FILE}'")
    state = settings.state.path
    if not _is_running(state):
        raise refuse(state, "", "no daemon runs that keeps its state there", "start it, or name its --config")
    path = submission_path(state)
    with replacing(path) as stream:
        os.chmod(stream.fileno(), 0o644)
        stream.write(f"{value_degC!r} {settings.reference.sigma_degC if sigma_degC is None else sigma_degC!r}\n")
    at_s = os.stat(path).st_mtime_ns / 1e9
    end_s = time.monotonic() + _PATIENCE_S + 2 / settings.rate_hz
    while os.path.exists(path):
        if time.monotonic() > end_s:
            remove(path)
            raise refuse(path, "", "the daemon has not taken it", "let it read its configuration again (SIGHUP)")
        time.sleep(0.02)
    last = _last(state)
    if last is None or last.unix_s != at_s:
        raise refuse(path, "", "another reading took its place", "repeat the command")
    if not last.counted:
        raise refuse(
            "ambientd tell", "", f"not counted: {last.outcome}", "hand over another later; the offset stays as it was"
        )
    print(f"counted, {last.outcome}")


def _is_running(state_path: str) -> bool:
    """Whether a daemon holds the lock beside its state."""
    try:
        descriptor = os.open(f"{state_path}.lock", os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    except OSError as error:
        hint = "run it as the user that the daemon runs as, or as root"
        raise refuse(f"{state_path}.lock", "", f"cannot be opened ({error.strerror})", hint) from error
    try:
        os.lockf(descriptor, os.F_TEST, 0)
    except (BlockingIOError, PermissionError):
        return True
    finally:
        os.close(descriptor)
    return False


def _last(state_path: str) -> LastReference | None:
    try:
        offset = decode(read_whole(state_path, LARGEST_BYTES)).offset
    except (Refused, ValueError):
        return None
    return None if offset is None else offset.last
