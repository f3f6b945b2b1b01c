"""The simulated laboratory of a campaign; the drivers get ports and a shell, and do not know that it is simulated.

What is simulated takes the place of what the campaign names: ports, the connection to the device, and the commands of
its actions, each of which the simulated phone knows by its name.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from ambient_model.faults import Fault, Refused
from ambient_trainer.laboratory.campaign import Campaign, LoadedCampaign
from ambient_trainer.laboratory.instruments import instrument
from ambient_trainer.laboratory.messages import Clock
from ambient_trainer.laboratory.simulation.phone import SimulatedPhone
from ambient_trainer.simulator import Device, Zone, load_device
from ambient_trainer.simulator.run import stream

_SWITCH_S = 2e-4


class SimulatedLaboratory(NamedTuple):
    """The campaign with the simulated instruments' ports in it, what the device's shells need, and the instruments."""

    loaded: LoadedCampaign
    environment: Mapping[str, str]
    chamber: Any
    multiplexer: Any
    thermometer: Any
    phone: SimulatedPhone


@contextlib.contextmanager
def simulated_laboratory(loaded: LoadedCampaign, clock: Clock, seed: int = 0) -> Iterator[SimulatedLaboratory]:
    """The simulated laboratory for a campaign, for the time of a ``with`` block.

    It begins with the chamber at the program's first set point and the phone in equilibrium with it. With the same
    ``seed``, chamber, probes and phone have the swing, errors and noise of
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

        chamber = simulated(named.chamber, stream(seed, "wobble"), first.chamber_degC)
        probes = sorted(named.multiplexer.probes, key=named.multiplexer.probes.__getitem__)
        errors_K = device.chamber.probes.calibration_degC * stream(seed, "probes").standard_normal(len(probes))
        multiplexer = simulated(named.multiplexer, chamber.air_degC, seed, dict(zip(probes, errors_K.tolist())))
        thermometer = simulated(named.thermometer, chamber.air_degC) if named.thermometer else None
        supply = campaign.laboratory.device.power_supply
        activity = first.load[0] if first.load else device.idle
        phone = stack.enter_context(
            SimulatedPhone(clock, chamber.air_degC, device, zones, supply, activity, seed, campaign.before_s)
        )
        ports = {"chamber": chamber.port, "multiplexer": multiplexer.port}
        if thermometer is not None:
            ports["thermometer"] = thermometer.port
        there = loaded._replace(campaign=_with_simulated(campaign, ports, phone.root))
        yield SimulatedLaboratory(there, phone.environment, chamber, multiplexer, thermometer, phone)


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
