"""Every number of the simulated phone stands here, with its unit and where it comes from.

``chosen``: picked by hand within what such a phone has, so that the sensors' means in scenarios 1, 2.1, 2.3 and 2.4
come near the thesis's.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

NODES = ("soc", "board", "flash", "battery", "usb", "display", "back")

CAPACITANCE_J_K = {  # chosen: 172 g (Xperia 5 IV) at about 0.85 J/(g K), most of it battery, display and back
    "soc": 2.0,
    "board": 14.0,
    "flash": 3.0,
    "battery": 62.0,
    "usb": 5.0,
    "display": 38.0,
    "back": 22.0,
}

CONDUCTANCE_W_K = {  # chosen
    ("soc", "board"): 0.045,
    ("board", "flash"): 0.07,
    ("board", "battery"): 0.5,
    ("board", "display"): 0.035,
    ("board", "back"): 0.03,
    ("flash", "back"): 0.02,
    ("battery", "display"): 0.08,
    ("battery", "back"): 0.065,
    ("battery", "usb"): 0.006,
    ("usb", "display"): 0.025,
    ("usb", "back"): 0.012,
}

SURFACE_M2 = {  # 156 mm x 67 mm (Xperia 5 IV); the back lies on foam, which covers part of it; the rest chosen
    "flash": 0.0002,
    "usb": 0.0008,
    "display": 0.0105,
    "back": 0.0060,
}

CONVECTION_W_M2_K125 = 2.75  # h = 1.4 (dT / L)^0.25 for laminar air along a plate (textbook), L = 67 mm
EMISSIVITY = 0.9  # glass (textbook)
STEFAN_BOLTZMANN_W_M2_K4 = 5.670374419e-8  # CODATA
ZERO_DEGC_K = 273.15

GOVERNOR_DEGC = (84.0, 92.0)  # full power below the first, the floor above the second; the thesis sees 90 at full load
GOVERNOR_FLOOR = 0.15  # share of the demanded power that is left; chosen

BATTERY_V = 3.85  # nominal of a lithium-ion cell
BATTERY_OHM = 0.08  # chosen: cell, protection and contacts


class Load(NamedTuple):
    """What an activity asks for; chosen. Watts are heat in the node of that name."""

    cpu_load_frac: float
    soc_W: float
    board_W: float
    """Power management, modem."""
    flash_W: float
    """The camera module sits beside the flash."""
    usb_W: float
    """The charging circuit's loss."""
    display_W: float
    charging_A: float = 0.0


class Activity(str, Enum):
    """What the phone does."""

    IDLE = "idle"
    CPU_50 = "cpu_50"
    CPU_100 = "cpu_100"
    CHARGING = "charging"
    CAMERA_1080P = "camera_1080p"
    CAMERA_4K = "camera_4k"
    STREAMING = "streaming"


LOADS = {
    Activity.IDLE: Load(0.02, 0.08, 0.03, 0.0, 0.0, 0.02),
    Activity.CPU_50: Load(0.5, 2.5, 0.15, 0.0, 0.0, 0.02),
    Activity.CPU_100: Load(1.0, 8.0, 0.30, 0.0, 0.0, 0.02),
    Activity.CHARGING: Load(0.02, 0.08, 0.50, 0.0, 0.40, 0.02, 3.0),
    Activity.CAMERA_1080P: Load(0.25, 2.5, 0.30, 0.25, 0.0, 0.15),
    Activity.CAMERA_4K: Load(0.45, 3.6, 0.60, 0.40, 0.0, 0.15),
    Activity.STREAMING: Load(0.12, 0.9, 0.50, 0.0, 0.0, 0.25),
}

SENSORS = ("soc", "flash", "battery", "usb", "display")
SENSOR_LAG_S = {"soc": 2.0, "flash": 5.0, "battery": 15.0, "usb": 8.0, "display": 8.0}  # chosen: thermistors on a board
SENSOR_NOISE_DEGC = 0.03  # standard deviation before rounding; chosen
SENSOR_DIGITS = 1  # reads tenths of a degree

PROBES = 4  # the thesis: several, averaged
PROBE_LAG_S = 4.0  # chosen: a bare thermocouple in moving air
PROBE_CALIBRATION_DEGC = 0.1  # each probe's constant error, standard deviation; the thesis's reference thermometer
PROBE_NOISE_DEGC = 0.02  # each probe's, standard deviation; chosen
PROBE_DIGITS = 3

CHAMBER_RAMP_K_S = 3.0 / 60.0  # chosen: such a chamber does 2 to 4 K/min
CHAMBER_WOBBLE_DEGC = 0.4  # standard deviation, so that it stays within about 1 degC; chosen
CHAMBER_WOBBLE_S = 240.0  # how long the wobble remembers; chosen
