"""``ambientd replay``: the daemon's estimates for a trace, as fast as it goes."""

import os

from ambient_model.atomic import replacing
from ambient_model.codec import load_model
from ambient_model.faults import refuse
from ambientd.sources.replay import TraceSource, tracker_for

COLUMNS = ("time_s", "ambient_degC", "low_degC", "high_degC", "status")


def replay(model_path: str, trace_path: str, output_path: str, from_s: float | None, to_s: float | None) -> str:
    """Write the estimates for a trace and say how many; raises :class:`Refused`, and then leaves the output alone.

    Numbers are written with the fewest digits that read back as the same number, a missing value as an empty cell.
    """
    for given in (model_path, trace_path):
        if os.path.exists(output_path) and os.path.exists(given) and os.path.samefile(given, output_path):
            raise refuse(output_path, "", "would be overwritten by what is made from it", "name another -o")
    model = load_model(model_path)
    with TraceSource(trace_path, model.main.inputs, from_s, to_s) as source:
        update = tracker_for(model, source).update
        count = known = 0
        with replacing(output_path, "gz" if output_path.endswith(".gz") else "w") as stream:
            stream.write(",".join(COLUMNS) + "\n")
            for time_s, readings in source:
                ambient, low, high, status, _ = update(time_s, readings)
                if ambient is None:
                    stream.write(f"{time_s!r},,,,{status}\n")
                else:
                    stream.write(f"{time_s!r},{ambient!r},{low!r},{high!r},{status}\n")
                    known += 1
                count += 1
    return f"{count} estimates" if known == count else f"{known} estimates in {count} rows"
