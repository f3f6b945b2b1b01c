"""Simulated devices and the scenarios they go through; everything that comes from here is simulated."""

from ambient_trainer.simulator.chamber import Probes, coloured
from ambient_trainer.simulator.device import (
    Constant,
    Device,
    Zone,
    device_names,
    device_path,
    load_constants,
    load_device,
    rounded,
    with_calibrated,
)
from ambient_trainer.simulator.fleet import Unit, drawn, nominal, unit_run
from ambient_trainer.simulator.heat import HeatBalance
from ambient_trainer.simulator.hidden import Hidden
from ambient_trainer.simulator.hidden import effects as effect_kinds
from ambient_trainer.simulator.live import Sensors
from ambient_trainer.simulator.run import Driven, Progress, Run, bursts, integrate, prepare, stream
from ambient_trainer.simulator.scenario import Scenario, ScenarioStep, load_scenario, scenario_names
from ambient_trainer.simulator.signals import SIGNALS
from ambient_trainer.simulator.simulate import Planned, Simulated, Truth, logged, simulate, simulate_many
from ambient_trainer.simulator.text import draw_hidden
