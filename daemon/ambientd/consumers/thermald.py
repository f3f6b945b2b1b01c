"""thermald: a file as a sensor, whose trip points it acts on."""

import os

from ambientd.consumers import Reading


def reads(root: str) -> list[Reading]:
    """Each file that its configuration names as a sensor."""
    from xml.etree import ElementTree

    try:
        tree = ElementTree.parse(os.path.join(root, "etc/thermald/thermal-conf.xml"))
    except (OSError, ElementTree.ParseError):
        return []
    found = []
    for sensor in tree.iter("ThermalSensor"):
        kind, path = (sensor.findtext(each, "").strip() for each in ("Type", "Path"))
        trips = [each for each in tree.iter("TripPoint") if each.findtext("SensorType", "").strip() == kind]
        temperatures = [each.findtext("Temperature", "").strip() for each in trips]
        acts = max((int(each) for each in temperatures if each.isdigit()), default=None)
        found.append(Reading(path, "root", acts, None, "takes a missing file for 0 degC, and stops cooling,"))
    return found
