"""A report of a fleet that was fitted in a moment."""

import tempfile
from dataclasses import replace

import ambient_trainer as at
from ambient_trainer.report import Report
from ambient_trainer.simulator.fleet import FleetPlan, fleet


def samples() -> dict[str, Report]:
    import pandas as pd

    units = fleet(FleetPlan("5", 6, seed=3, period_s=30.0, minutes=60.0))
    frame = pd.concat([each.trace.to_frame().assign(unit=each.name, case=each.case) for each in units])
    frame.loc[frame["unit"] == "u00004", "ambient_degC"] = float("nan")
    with tempfile.TemporaryDirectory() as folder:
        found = at.fit_fleet(frame, "free-1", folder, within=["case"], engine="serial", effort=at.Effort(starts=1))
        outliers = (found.fitted.outliers[0]._replace(improbability=6.0, cause="sensor_bias", location="usb"),)
        return {"fleet": replace(found, fitted=replace(found.fitted, outliers=outliers)).summary}
