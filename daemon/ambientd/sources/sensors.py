"""All sensors of a model, read together: one that fails, or is implausible, is set aside and delays no other.

It is reported once when it fails and once when it returns, and searched for again, by name, less and less often.
"""

from collections.abc import Callable, Collection, Sequence

from ambient_model.faults import Fault
from ambientd.notices import Notice
from ambientd.sources import reader
from ambientd.sources.reader import Content, Reader
from ambientd.sources.sensor import Sensor
from ambientd.sources.supervision import BackOff, Rules, Supervision, outside
from ambientd.sources.trial import Trial, finished


class Sensors:
    """Some sensors, in their order. ``note`` takes a message for each that fails or returns.

    ``set_alarm`` and ``period_s`` are :class:`Reader`'s; without an alarm, one that hangs delays the others.
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        rules: Rules,
        note: Callable[[str], None],
        set_alarm: Callable[[float], None] = lambda after_s: None,
        period_s: float = 1.0,
    ) -> None:
        self._sensors = sensors
        self._back_offs = [BackOff() for _ in sensors]
        self._notices = [Notice() for _ in sensors]
        self.reader = Reader(set_alarm, period_s)
        self._supervision = Supervision([each.given for each in sensors], rules)
        self._note = note
        self._contents: list[Content] = []
        """What the last reading read, where every sensor gave a value in its range, and its values:"""
        self._values: list[float | None] = []
        self._is_calm = False
        """Whether nothing is wrong that was reported, and no rule asks for the time of each reading."""
        self._descriptors: list[int] = []
        for sensor in sensors:
            sensor.open()
            if len(sensor.paths) > 1:
                note(f"sensor {sensor.name}: {len(sensor.paths)} have this name, reading {sensor.paths[0]}")

    def read(self, now_s: float) -> list[float | None]:
        """One value per input in its unit, None where it is missing; ``now_s`` paces the search for what is lost.

        A value outside its input's range is reported and returned, so that it is published as read; no estimate uses
        it.
        """
        if not self._contents:  # one may have been opened or closed since
            self._descriptors = [sensor.descriptor for sensor in self._sensors]
        contents = self.reader.read(self._descriptors)
        if contents == self._contents:  # most zones read the same for a second
            return self._values
        values: list[float | None] = []
        is_calm = self._is_calm
        for sensor, content in zip(self._sensors, contents):
            if content == sensor.content:
                values.append(sensor.value)
            else:
                values.append(sensor.take(content))
                is_calm = is_calm and sensor.content is content
        if is_calm:
            self._contents, self._values = contents, values
        else:
            self._contents = []
            self._judge(now_s, values)
        return values

    def _judge(self, now_s: float, values: list[float | None]) -> None:
        """Search for what is missing, set aside what is implausible, and report what has changed."""
        if None in values:
            self._try_again(now_s, values)
        doubts = self._supervision.in_wrong_units(values)
        if self._supervision.watches:
            doubts |= self._supervision.doubts(now_s, values)
        self._is_calm = not self._supervision.watches
        for index, (value, sensor, notice) in enumerate(zip(values, self._sensors, self._notices)):
            if value is None:
                trouble = f"no value ({sensor.trouble})"
            else:
                doubt = doubts.get(index) or outside(sensor.given, value)
                trouble = f"set aside ({doubt})" if doubt else ""
            if notice.changed(now_s, bool(trouble)):
                self._note(f"sensor {sensor.name}: {trouble or 'is back'}")
            self._is_calm = self._is_calm and not notice.wrong
        for index in doubts:
            values[index] = None

    def faults(self, names: Collection[str]) -> list[Fault]:
        """What is wrong with those of ``names`` that give no value now."""
        sensors = [each for each in self._sensors if each.name in names]
        return [
            Fault(f"sensor {sensor.name}", sensor.trouble, sensor.hint())
            for sensor, value in zip(sensors, values_of(sensors))
            if value is None
        ]

    def _try_again(self, now_s: float, values: list[float | None]) -> None:
        """Look those up anew that gave no value, where it is time to, and put their values into ``values``."""
        places = [place for place, value in enumerate(values) if value is None and self._back_offs[place].due(now_s)]
        sensors = [self._sensors[place] for place in places]
        for sensor in sensors:
            sensor.open()
        self.reader.begin()
        contents = self.reader.read([sensor.descriptor for sensor in sensors])
        for place, sensor, content in zip(places, sensors, contents):
            values[place] = sensor.take(content)

    def close(self) -> None:
        """Close all descriptors."""
        for sensor in self._sensors:
            sensor.close()


def values_of(sensors: Sequence[Sensor]) -> list[float | None]:
    """One value per sensor, None where it has none now or does not answer in time; each is read in a thread."""
    trials = [Trial(sensor.paths[0]) if sensor.descriptor >= 0 else None for sensor in sensors]
    finished([trial for trial in trials if trial is not None], reader.PATIENCE_S)
    return [sensor.take(None if trial is None else trial.content) for sensor, trial in zip(sensors, trials)]
