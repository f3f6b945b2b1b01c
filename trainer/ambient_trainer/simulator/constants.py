"""What is chosen or known of the simulated phone, each number with its unit and where it comes from.

``chosen``: picked by hand within what such a phone has. What is calibrated to the thesis stands in ``phone.yaml``.
"""

from __future__ import annotations

from enum import Enum

NODES = ("soc", "board1", "board2", "modem", "camera", "flash", "battery", "usb", "display", "back", "frame")


class Activity(str, Enum):
    """What the phone does."""

    IDLE = "idle"
    CPU_50 = "cpu_50"
    CPU_100 = "cpu_100"
    CHARGING = "charging"
    CAMERA_1080P = "camera_1080p"
    CAMERA_4K = "camera_4k"
    STREAMING = "streaming"


CAPACITANCE_J_K = {  # chosen; with the calibrated ones about 172 g (Xperia 5 IV) at 0.8 to 1.0 J/(g K)
    "soc": 3.0,  # package, memory on top of it and its heat spreader
    "modem": 3.0,
    "camera": 6.0,
    "flash": 1.5,
    "usb": 3.0,
}

SURFACE_M2 = {  # 156 mm x 67 mm x 8.2 mm (Xperia 5 IV); the back lies on foam, which covers part of it (chosen)
    "camera": 0.0006,
    "flash": 0.0001,
    "usb": 0.0003,
    "display": 0.0100,
    "back": 0.0060,
    "frame": 0.0034,
}

EMISSIVITY = 0.9  # glass and painted metal (textbook)
STEFAN_BOLTZMANN_W_M2_K4 = 5.670374419e-8  # CODATA
ZERO_DEGC_K = 273.15

GOVERNOR_LOW_DEGC = 88.0  # full power below it; the thesis sees the die at about 90 under full load
GOVERNOR_HIGH_DEGC = 92.0  # the floor above it
GOVERNOR_FLOOR_FRAC = 0.1  # share of the demanded power that is always left; chosen

BATTERY_V = 3.85  # nominal of a lithium-ion cell
BATTERY_OHM = 0.08  # at 25 degC; chosen: cell, protection and contacts
BATTERY_OHM_ACTIVATION_K = 2000.0  # Arrhenius: a quarter less at 40 degC, nearly twice at 0 degC; chosen
BATTERY_REFERENCE_DEGC = 25.0

POWER_W = {  # heat in a node while an activity lasts; chosen
    "idle.display": 0.0,  # screen off
    "idle.modem": 0.01,
    "cpu_50.soc": 3.0,
    "cpu_50.board2": 0.25,
    "cpu_100.soc": 9.0,  # demanded by all cores: enough for the governor to have work at any ambient
    "charging.board2": 0.8,  # what a charger of 12 W loses, with power management
    "charging.usb": 0.3,  # contacts and cable
    "camera_1080p.modem": 0.02,
    "camera_1080p.display": 0.25,
    "camera_4k.modem": 0.02,
    "camera_4k.display": 0.25,
    "streaming.display": 0.3,
}

CHARGING_A = {Activity.CHARGING: 3.0}  # into the battery; about 12 W, chosen

CPU_LOAD_FRAC = {  # what the system would report; the thesis's for 50 and 100 %, the rest chosen
    Activity.IDLE: 0.02,
    Activity.CPU_50: 0.5,
    Activity.CPU_100: 1.0,
    Activity.CHARGING: 0.02,
    Activity.CAMERA_1080P: 0.25,
    Activity.CAMERA_4K: 0.45,
    Activity.STREAMING: 0.15,
}

BURSTS_PERIOD_S = 400.0  # of download and decoding while streaming: three in scenario 2.4; chosen

PROBES = 4  # the thesis: several, averaged
PROBE_LAG_S = 4.0  # chosen: a bare thermocouple in moving air
PROBE_CALIBRATION_DEGC = 0.1  # each probe's constant error, standard deviation; the thesis's reference thermometer
PROBE_NOISE_DEGC = 0.02  # each probe's, standard deviation; chosen
PROBE_DIGITS = 3

CHAMBER_SETTLING_S = 60.0  # the air behind the controller's ramp; chosen
CHAMBER_WOBBLE_PERIOD_S = 900.0  # of the controller's swing about the set point; chosen
CHAMBER_DRAUGHT_DEGC = 0.08  # standard deviation of what is irregular; chosen
CHAMBER_DRAUGHT_S = 60.0  # how long a draught lasts; chosen
