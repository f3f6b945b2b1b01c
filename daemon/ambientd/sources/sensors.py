"""All sensors of a model, read together: one that fails, or is not believed, is set aside and holds up no other.

It is told of once when it goes and once when it returns, and looked up again, by name, less and less often.
"""

from collections.abc import Callable, Sequence

from ambientd.notices import Notice
from ambientd.sources.sensor import Sensor
from ambientd.sources.supervision import BackOff, Rules, Supervision, outside


class Sensors:
    """Some sensors, in their order. ``note`` is told what goes and what returns, once each."""

    def __init__(self, sensors: Sequence[Sensor], rules: Rules, note: Callable[[str], None]) -> None:
        self._sensors = [(sensor, BackOff(), Notice()) for sensor in sensors]
        self._supervision = Supervision([each.given for each in sensors], rules)
        self._note = note
        for sensor in sensors:
            sensor.open()
            if len(sensor.paths) > 1:
                note(f"sensor {sensor.name}: {len(sensor.paths)} answer to this name, taking {sensor.paths[0]}")

    def read(self, now_s: float) -> list[float | None]:
        """One value per input in its unit, None where it is missing; ``now_s`` paces the search for what is lost.

        A value outside its input's range is told of, and given: what it was is to be seen, and no estimate uses it.
        """
        values = [self._value(now_s, sensor, back_off) for sensor, back_off, _ in self._sensors]
        doubts = self._supervision.judge(now_s, values)
        for index, (sensor, _, notice) in enumerate(self._sensors):
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

    def _value(self, now_s: float, sensor: Sensor, back_off: BackOff) -> float | None:
        value = sensor.read()
        if value is None and back_off.due(now_s):
            sensor.open()
            value = sensor.read()
        return value

    def close(self) -> None:
        """Let all descriptors go."""
        for sensor, _, _ in self._sensors:
            sensor.close()
