"""``collect --simulate``: a campaign's instruments, simulated; the drivers get ports and a shell, and know nothing.

What is simulated takes the place of what the campaign names: ports, the way to the device, and the commands of its
actions, each of which the simulated phone knows by its name.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from ambient_model.faults import Fault, Refused
from ambient_trainer.laboratory.campaign import Action, Campaign, Device, Instruments, Loaded
from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.rehearsal.phone import SimulatedPhone
from ambient_trainer.laboratory.simulated.chamber import SimulatedChamber
from ambient_trainer.laboratory.simulated.multiplexer import SimulatedMultiplexer
from ambient_trainer.laboratory.simulated.thermometer import SimulatedThermometer
from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.constants import Activity
from ambient_trainer.simulator.run import stream
from ambient_trainer.simulator.zones import Zone, all_zones

_SWITCH_S = 2e-4
_ACTIVITIES = {activity.value: activity for activity in Activity if activity is not Activity.IDLE}


class Rehearsal(NamedTuple):
    """A laboratory that only looks like one."""

    loaded: Loaded
    """The campaign with the simulated instruments' ports in it."""
    environment: Mapping[str, str]
    """What the device's shells need."""
    chamber: SimulatedChamber
    multiplexer: SimulatedMultiplexer
    thermometer: SimulatedThermometer | None
    phone: SimulatedPhone


@contextlib.contextmanager
def rehearsal(loaded: Loaded, clock: Clock, seed: int = 0) -> Iterator[Rehearsal]:
    """The simulated laboratory for ``loaded``; raises :class:`Refused` for what the simulated phone does not have.

    It begins with the chamber at the program's first set point and the phone at rest in it. With the same ``seed``,
    chamber, probes and phone have the swing, errors and noise of :func:`ambient_trainer.simulator.phone.simulate`.
    """
    campaign = loaded.campaign
    zones = _zones(loaded)
    links, first = campaign.laboratory.instruments, campaign.program[0]
    with contextlib.ExitStack() as stack:
        # many threads that each do little: with the usual 5 ms, an answer costs a second of a fast clock
        stack.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(_SWITCH_S)
        wobble = stream(seed, "wobble")
        chamber = SimulatedChamber(
            clock,
            room_degC=first.chamber_degC,
            seed=wobble,
            pause_s=links.chamber.pause_s,
        )
        stack.callback(chamber.close)
        channels = sorted(links.multiplexer.probes.values())
        errors_K = c.PROBE_CALIBRATION_DEGC * stream(seed, "probes").standard_normal(len(channels))
        multiplexer = SimulatedMultiplexer(
            clock, chamber.air_degC, channels=channels, seed=seed, errors_K=dict(zip(channels, errors_K.tolist()))
        )
        stack.callback(multiplexer.close)
        thermometer = None
        if link := links.thermometer:
            thermometer = SimulatedThermometer(clock, chamber.air_degC, address=link.address)
            stack.callback(thermometer.close)
        supply = campaign.laboratory.device.power_supply
        before_s = sum(60.0 * (step.duration_min or 0.0) for step in campaign.before)
        doing = _ACTIVITIES[first.load[0]] if first.load else Activity.IDLE
        phone = stack.enter_context(SimulatedPhone(clock, chamber.air_degC, zones, supply, doing, seed, before_s))
        ports = {"chamber": chamber.port, "multiplexer": multiplexer.port}
        if thermometer is not None:
            ports["thermometer"] = thermometer.port
        there = loaded._replace(campaign=_rehearsed(campaign, ports, phone.root))
        yield Rehearsal(there, phone.environment, chamber, multiplexer, thermometer, phone)


def _rehearsed(campaign: Campaign, ports: Mapping[str, str], root: str) -> Campaign:
    laboratory = campaign.laboratory
    links = {
        name: getattr(laboratory.instruments, name).model_copy(update={"port": port}) for name, port in ports.items()
    }
    there = laboratory.model_copy(
        update={
            "instruments": Instruments.model_copy(laboratory.instruments, update=links),
            "device": Device.model_copy(laboratory.device, update={"connect": "adb", "root": root, "setup": ""}),
            "actions": {name: _rehearsed_action(name, each) for name, each in laboratory.actions.items()},
        }
    )
    return campaign.model_copy(update={"laboratory": there})


def _rehearsed_action(name: str, action: Action) -> Action:
    return action.model_copy(update={"start": f"phone start {name}", "stop": f"phone stop {name}"})


def _zones(loaded: Loaded) -> dict[str, Zone]:
    """By the type that the campaign reads, the simulated zone that its column names; raises :class:`Refused`."""
    known = {f"{zone.name}_degC": zone for zone in all_zones()}
    campaign = loaded.campaign
    faults = [
        Fault(f"laboratory.device.zones.{kind}", f"the simulated phone has no {column}", f"it has {', '.join(known)}")
        for kind, column in campaign.laboratory.device.zones.items()
        if column not in known
    ]
    for part, steps in (("before", campaign.before), ("steps", campaign.steps)):
        for index, step in enumerate(steps):
            strange = [name for name in step.load if name not in _ACTIVITIES]
            if strange or len(step.load) > 1:
                problem = f"the simulated phone cannot do {' and '.join(step.load)}"
                mend = f"it does one at a time of {', '.join(_ACTIVITIES)}"
                faults.append(Fault(f"{part}[{index}].load", problem, mend))
    if faults:
        raise Refused(loaded.path, faults)
    return {kind: known[column] for kind, column in campaign.laboratory.device.zones.items()}
