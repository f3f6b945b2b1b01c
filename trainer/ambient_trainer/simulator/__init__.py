"""Simulated devices and the scenarios they go through; everything that comes from here is simulated."""

from ambient_trainer.simulator.device import Device, Zone
from ambient_trainer.simulator.device_file import device_names, load_device
from ambient_trainer.simulator.hidden import Effect, Hidden
from ambient_trainer.simulator.scenario import Scenario, load_scenario, scenario_names
from ambient_trainer.simulator.simulate import Simulated, simulate, simulate_many
from ambient_trainer.simulator.stepper import Stepper
from ambient_trainer.simulator.truth import Truth

__all__ = [
    "Device",
    "Effect",
    "Hidden",
    "Scenario",
    "Simulated",
    "Stepper",
    "Truth",
    "Zone",
    "device_names",
    "load_device",
    "load_scenario",
    "scenario_names",
    "simulate",
    "simulate_many",
]
