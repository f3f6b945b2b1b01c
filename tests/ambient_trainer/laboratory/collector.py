"""``collect`` as a process of its own, on ports of a laboratory that lives elsewhere in fast time: it can be killed.

``collector.py CAMPAIGN.yaml TRACE.csv SPEED [resume]`` prints how many of its samples are on the disk, whenever that
changes, and what happens. The calendar is ``STEPPED_S`` ahead.
"""

import os
import signal
import sys
import time

from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.collect import Job, collect, resume
from ambient_trainer.laboratory.run import Supervision


def event(at_s, text):
    print("event", f"{at_s:.0f}", text, flush=True)


def main():
    calendar_s, ahead_s = time.time, float(os.environ.get("STEPPED_S", "0"))
    time.time = lambda: calendar_s() + ahead_s
    path, output, speed, *words = sys.argv[1:]
    asked, printed = [], [0]

    def update(run):
        if run.journal.samples_on_disk != printed[0]:
            printed[0] = run.journal.samples_on_disk
            print("disk", printed[0], flush=True)

    signal.signal(signal.SIGTERM, lambda number, _: asked.append(number))
    job = Job(load_campaign(path), output, float(speed))
    supervision = Supervision(update, event, lambda: "stopped" if asked else None, lambda: False)
    outcome = (resume if words == ["resume"] else collect)(job, supervision).outcome
    print("end", outcome.ending.value, outcome.safe, flush=True)


main()
