"""The simulated laboratory of a campaign; the drivers get ports and a shell, and do not know that it is simulated.

What is simulated takes the place of what the campaign names: ports, the connection to the device, and the commands of
its actions, each of which the simulated phone knows by its name.
"""

import contextlib
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from ambient_model.faults import Fault, Refused
from ambient_trainer.laboratory.campaign import Campaign, LoadedCampaign
from ambient_trainer.laboratory.instruments import ROLES, instrument
from ambient_trainer.laboratory.messages import Clock
from ambient_trainer.laboratory.simulation.phone import SimulatedPhone
from ambient_trainer.simulator import Device, Zone, load_device
from ambient_trainer.simulator.run import stream

_SWITCH_S = 2e-4
_ROOM_DEGC = 22.0
_ROOM_SWINGS = {86400.0: 1.5, 9000.0: 0.8, 1500.0: 0.3}  # period in s, and size in K; chosen


class SimulatedLaboratory(NamedTuple):
    """The campaign with the simulated instruments' ports in it, what the device's shells need, and the instruments."""

    loaded: LoadedCampaign
    environment: Mapping[str, str]
    chamber: Any
    multiplexer: Any
    thermometer: Any
    air_degC: Callable[[float], float]
    phone: SimulatedPhone


@contextlib.contextmanager
def simulated_laboratory(loaded: LoadedCampaign, clock: Clock, seed: int = 0) -> Iterator[SimulatedLaboratory]:
    """The simulated laboratory for a campaign, for the time of a ``with`` block.

    It begins with the chamber at the program's first set point, or without one with a room's air, and the phone in
    equilibrium with it. With the same ``seed``, chamber, probes and phone have the swing, errors and noise of
    :func:`ambient_trainer.simulator.simulate`. Raises :class:`Refused` for what the simulated phone has not.
    """
    campaign = loaded.campaign
    device = load_device()
    zones = _zones(loaded, device)
    named, first = campaign.laboratory.instruments, campaign.program[0]
    with contextlib.ExitStack() as stack:
        # many threads that each do little: with the usual 5 ms, an answer costs a second of a fast clock
        stack.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(_SWITCH_S)

        def simulated(settings: Any, *arguments: object) -> Any:
            made = instrument(settings.kind).Simulated(settings, clock, *arguments)
            stack.callback(made.close)
            return made

        made: dict[str, Any] = dict.fromkeys(ROLES)
        if named.chamber is not None:
            made["chamber"] = simulated(named.chamber, stream(seed, "wobble"), first.chamber_degC)
        air_degC = made["chamber"].air_degC if made["chamber"] else room_air(seed)
        if named.multiplexer is not None:
            channels = named.multiplexer.probes
            probes = sorted(channels, key=lambda name: str(channels[name]))
            errors_K = device.chamber.probes.calibration_degC * stream(seed, "probes").standard_normal(len(probes))
            made["multiplexer"] = simulated(named.multiplexer, air_degC, seed, dict(zip(probes, errors_K.tolist())))
        if named.thermometer is not None:
            made["thermometer"] = simulated(named.thermometer, air_degC)
        supply, activity = campaign.laboratory.device.power_supply, first.load[0] if first.load else device.idle
        phone = SimulatedPhone(clock, air_degC, device, zones, supply, activity, seed, campaign.before_s)
        stack.enter_context(phone)
        ports = {role: each.port for role, each in made.items() if each}
        there = loaded._replace(campaign=_with_simulated(campaign, ports, phone.root))
        yield SimulatedLaboratory(there, phone.environment, **made, air_degC=air_degC, phone=phone)


def room_air(seed: int) -> Callable[[float], float]:
    """A room's air in degC over time: the day's swing, the heating's, and a window now and then."""
    phases = stream(seed, "room").uniform(0.0, 2.0 * math.pi, len(_ROOM_SWINGS))
    swings = [(each_s, size_K, phase) for (each_s, size_K), phase in zip(_ROOM_SWINGS.items(), phases.tolist())]
    return lambda at_s: (
        _ROOM_DEGC + sum(size_K * math.sin(math.tau * at_s / each_s + phase) for each_s, size_K, phase in swings)
    )


def _with_simulated(campaign: Campaign, ports: Mapping[str, str], root: str) -> Campaign:
    laboratory = campaign.laboratory
    settings = {
        role: getattr(laboratory.instruments, role).model_copy(update={"port": port}) for role, port in ports.items()
    }
    actions = {
        name: action.model_copy(update={"start": f"phone start {name}", "stop": f"phone stop {name}"})
        for name, action in laboratory.actions.items()
    }
    there = {
        "instruments": laboratory.instruments.model_copy(update=settings),
        "device": laboratory.device.model_copy(update={"connect": "adb", "root": root, "setup": ""}),
        "actions": actions,
    }
    return campaign.model_copy(update={"laboratory": laboratory.model_copy(update=there)})


def _zones(loaded: LoadedCampaign, device: Device) -> dict[str, Zone]:
    """By the type that the campaign reads, the simulated zone that its column names; raises :class:`Refused`."""
    known = {f"{zone.name}_degC": zone for zone in device.zones}
    campaign, does = loaded.campaign, [name for name in device.activities if name != device.idle]
    faults = [
        Fault(f"laboratory.device.zones.{kind}", f"the simulated phone has no {column}", f"it has {', '.join(known)}")
        for kind, column in campaign.laboratory.device.zones.items()
        if column not in known
    ]
    for part, steps in (("before", campaign.before), ("steps", campaign.steps)):
        for index, step in enumerate(steps):
            if len(step.load) > 1 or any(name not in does for name in step.load):
                problem = f"the simulated phone cannot do {' and '.join(step.load)}"
                hint = f"it does one at a time of {', '.join(does)}"
                faults.append(Fault(f"{part}[{index}].load", problem, hint))
    if faults:
        raise Refused(loaded.path, faults)
    return {kind: known[column] for kind, column in campaign.laboratory.device.zones.items()}
