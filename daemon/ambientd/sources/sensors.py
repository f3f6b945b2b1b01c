"""All sensors of a model, read together: one that fails, or is implausible, is set aside and delays no other.

It is reported once when it fails and once when it returns, and searched for again, by name, less and less often.
"""

from collections.abc import Callable, Collection, Sequence

from ambient_model.faults import Fault
from ambientd.notices import Notice
from ambientd.sources.reader import Reader
from ambientd.sources.sensor import Sensor
from ambientd.sources.supervision import BackOff, Rules, Supervision, outside


class Sensors:
    """Some sensors, in their order. ``note`` takes a message for each that fails or returns."""

    def __init__(self, sensors: Sequence[Sensor], rules: Rules, note: Callable[[str], None]) -> None:
        self._sensors = sensors
        self._back_offs = [BackOff() for _ in sensors]
        self._notices = [Notice() for _ in sensors]
        self._reader = Reader()
        self._supervision = Supervision([each.given for each in sensors], rules)
        self._note = note
        for sensor in sensors:
            sensor.open()
            if len(sensor.paths) > 1:
                note(f"sensor {sensor.name}: {len(sensor.paths)} have this name, reading {sensor.paths[0]}")

    def read(self, now_s: float) -> list[float | None]:
        """One value per input in its unit, None where it is missing; ``now_s`` paces the search for what is lost.

        A value outside its input's range is reported and returned, so that it is published as read; no estimate uses
        it.
        """
        values = values_of(self._sensors, self._reader)
        if None in values:
            self._try_again(now_s, values)
        doubts = self._supervision.doubts(now_s, values)
        for index, (sensor, notice) in enumerate(zip(self._sensors, self._notices)):
            value = values[index]
            if value is None:
                trouble = f"no value ({sensor.trouble})"
            else:
                doubt = doubts.get(index) or outside(sensor.given, value)
                trouble = f"set aside ({doubt})" if doubt else ""
            if notice.changed(now_s, bool(trouble)):
                self._note(f"sensor {sensor.name}: {trouble or 'is back'}")
        for index in doubts:
            values[index] = None
        return values

    def faults(self, names: Collection[str]) -> list[Fault]:
        """What is wrong with those of ``names`` that give no value now."""
        values = values_of(self._sensors, self._reader) if names else []
        return [
            Fault(f"sensor {sensor.name}", sensor.trouble, sensor.source.hint())
            for sensor, value in zip(self._sensors, values)
            if value is None and sensor.name in names
        ]

    def _try_again(self, now_s: float, values: list[float | None]) -> None:
        """Look those up anew that gave no value, where it is time to, and put their values into ``values``."""
        places = [place for place, value in enumerate(values) if value is None and self._back_offs[place].due(now_s)]
        sensors = [self._sensors[place] for place in places]
        for sensor in sensors:
            sensor.open()
        for place, value in zip(places, values_of(sensors, self._reader)):
            values[place] = value

    def close(self) -> None:
        """Close all descriptors."""
        self._reader.close()
        for sensor in self._sensors:
            sensor.close()


def values_of(sensors: Sequence[Sensor], reader: Reader) -> list[float | None]:
    """One value per sensor, None where it has none now."""
    contents = reader.read([sensor.descriptor for sensor in sensors])
    return [sensor.take(content) for sensor, content in zip(sensors, contents)]
