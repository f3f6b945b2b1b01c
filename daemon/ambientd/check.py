"""``ambientd check``: whether a model file computes here what it must, its sensors are here, and its readers served."""

import errno
import math
import os
import stat
from collections.abc import Callable, Iterator

from ambient_model.codec import load_model
from ambient_model.conformance import (
    TOLERANCE,
    TOLERANCE_DEGC,
    worst_contradiction_of_guard,
    worst_contradictions,
    worst_difference_degC,
)
from ambient_model.faults import Fault, Refused, refuse
from ambient_model.model import Model
from ambientd.config import Settings
from ambientd.publish.access import Access
from ambientd.publish.swap import trial
from ambientd.sources.assign import assigned_sensors, location_of
from ambientd.sources.reader import Reader
from ambientd.sources.sensors import values_of
from ambientd.sources.supervision import outside

_LONGEST_SOCKET_PATH = 107


def check_files(settings: Settings) -> None:
    """Say what the model is and prove its recursion; raises :class:`Refused` where the file or the proof fails."""
    model = load_model(settings.model)
    _describe(settings, model)
    worst_degC = worst_difference_degC(model)
    if not worst_degC <= TOLERANCE_DEGC:
        raise refuse(
            settings.model,
            "conformance",
            f"this device computes {worst_degC:g} degC beside what the file says, and {TOLERANCE_DEGC:g} is allowed",
            "export the model again with 'ambient-trainer fit'; where it fails again, this Python computes wrong",
        )
    rows = len(model.conformance.inputs)
    _say("conformance", f"passed: {rows} samples at {len(model.main.discrete)} periods, to {worst_degC:g} degC")
    _check_fallbacks(model)
    if model.guard is not None:
        _check_guard(model)


def _check_fallbacks(model: Model) -> None:
    """As the file holds no outputs of its fallbacks, they are asked not to contradict themselves."""
    worst = worst_contradictions(model)
    doubtful = [name for name in worst if not worst[name] <= TOLERANCE]
    for name in doubtful:
        _say("warning", f"without {name} it contradicts itself by {_by(worst[name])}")
    if worst and not doubtful:
        _say("", f"passed: {len(worst)} fallbacks keep their equilibrium, and their periods agree")


def _check_guard(model: Model) -> None:
    """Nor does it hold outputs of its guard."""
    worst = worst_contradiction_of_guard(model)
    if worst <= TOLERANCE:
        _say("", "passed: the guard keeps its equilibrium, and its periods agree")
    else:
        _say("warning", f"the guard contradicts itself by {_by(worst)}")


def _by(contradiction: float) -> str:
    return f"{contradiction:g} (equilibrium moves, or periods disagree)"


def _describe(settings: Settings, model: Model) -> None:
    _say("model", f"{model.name}, created {model.created}")
    for each in model.main.inputs:
        _say("input", f"{each.column}, {each.min:g} to {each.max:g}, {location_of(settings, each)}")
    _say("states", ", ".join(model.main.states) or "none")
    _say("periods", f"{', '.join(f'{each.period_s:g}' for each in model.main.discrete)} s")
    _say("interval", _interval(model, settings.level_percent))
    if model.guard is not None:
        _say(
            "guard",
            f"has a say from {model.guard.threshold_degC:g} degC apart on, and the last word from twice that on",
        )
    _say("fallbacks", ", ".join(f"without {name}" for name in model.fallbacks) or "none")


def _interval(model: Model, level_percent: int) -> str:
    if model.spread is None:
        low, high = model.main.interval[level_percent]
        return f"{low:+g} to {high:+g} degC around the estimate, {level_percent} %"
    sigma = math.sqrt(model.spread.constant_degC2)
    low, high = (end * sigma for end in model.spread.quantiles[level_percent])
    causes = ", ".join(dict.fromkeys(term.of for term in model.spread.terms)) or "nothing"
    return f"{low:+.2g} to {high:+.2g} degC around the estimate at rest, {level_percent} %; wider with {causes}"


def check_sensors(settings: Settings) -> None:
    """Say what each input's sensor reads now; raises :class:`Refused` where one is missing or says nothing of use."""
    faults = []
    reader = Reader()
    for sensor in assigned_sensors(settings, load_model(settings.model)):
        sensor.open()
        (value,) = values_of([sensor], reader)
        sensor.close()
        place = f"sensor {sensor.name}"
        if value is None:
            faults.append(Fault(place, sensor.trouble, sensor.source.mend()))
        elif doubt := outside(sensor.given, value):
            faults.append(Fault(place, f"{sensor.paths[0]}: {doubt}", "name the right sensor, or fit the model to it"))
        else:
            others = f", the first of {len(sensor.paths)} by this name" if len(sensor.paths) > 1 else ""
            _say("sensor", f"{sensor.name}, {sensor.paths[0]}: {value:g} {sensor.source.unit}{others}")
    if faults:
        raise Refused(settings.sysfs_root, faults)


def check_all(settings: Settings, checks: tuple[Callable[[Settings], None], ...]) -> None:
    """Make all ``checks``, whatever one of them finds; raises :class:`Refused` with what all of them found."""
    refusals = []
    for check in checks:
        try:
            check(settings)
        except Refused as refused:
            refusals.append(refused)
    if len(refusals) == 1:
        raise refusals[0]
    if refusals:
        raise Refused(settings.source, [fault for refused in refusals for fault in refused.faults])


def check_outlets(settings: Settings) -> None:
    """Say what each published file and the state would be; raises :class:`Refused` where one cannot be written.

    A folder that is not there is told only: the service manager may make it at start.
    """
    faults = []
    for name, path, access, is_socket in _created(settings):
        if not os.path.isdir(os.path.dirname(path) or "."):
            _say("output", f"{name}: {os.path.dirname(path)} is not there; it must be when the daemon starts")
            continue
        try:
            _say("output", f"{name}: {_foreseen(path, access, is_socket)}")
        except OSError as error:
            faults.append(Fault(f"output {name}", f"cannot be written ({error.strerror or error})", _mend(error)))
    if faults:
        raise Refused(settings.source, faults)


def _created(settings: Settings) -> Iterator[tuple[str, str, Access, bool]]:
    """Of each thing that is created: its name, path and access, and whether it is a socket."""
    for spec in settings.publish:
        if spec.path:
            is_socket = spec.kind == "socket"
            yield str(spec), spec.path, spec.access.for_socket() if is_socket else spec.access, is_socket
    if settings.state is not None:
        yield f"state:{settings.state.path}", settings.state.path, settings.state.access, False


def _foreseen(path: str, access: Access, is_socket: bool) -> str:
    """Mode and owner of what would be made at ``path``; raises OSError where it could not be."""
    if os.path.lexists(path):
        mode = os.stat(path).st_mode
        if stat.S_ISDIR(mode):
            raise OSError(errno.EISDIR, "it is a folder")
        if is_socket and stat.S_ISSOCK(mode):
            return "there is a socket already, of a daemon that runs or that has died, or made by init"
        if is_socket:
            raise OSError(errno.EEXIST, "it exists and is no socket")
    if is_socket and len(os.fsencode(path)) > _LONGEST_SOCKET_PATH:
        raise OSError(errno.ENAMETOOLONG, f"its path is longer than {_LONGEST_SOCKET_PATH} bytes")
    return trial(path, access)


def _mend(error: OSError) -> str:
    if error.errno == errno.EPERM:
        return (
            "let the daemon run with that group, or with CAP_CHOWN and, under systemd, SystemCallFilter=@chown;"
            " and check as the user that it runs as"
        )
    return "choose another path, or see that the user that the daemon runs as may write there, and check as that user"


def say_unneeded(settings: Settings) -> None:
    """As :func:`check_sensors`, where nobody has said that the sensors should be here: what is missing is told only."""
    try:
        check_sensors(settings)
    except Refused as refused:
        for each in refused.faults:
            _say("sensor", f"{each.place.removeprefix('sensor ').removeprefix('input ')}: {each.problem}")
        _say("", "the model file is right; to run it on this device, name its zones in a configuration")


def _say(subject: str, text: str) -> None:
    print(f"{subject:<12} {text}")
