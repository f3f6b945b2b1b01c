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


class Printer:
    def __init__(self):
        self.printed = 0

    def update(self, run):
        count = run.journal.samples_on_disk
        if count != self.printed:
            self.printed = count
            print("disk", count, flush=True)

    def event(self, at_s, text):
        print("event", f"{at_s:.0f}", text, flush=True)


def main():
    calendar_s, ahead_s = time.time, float(os.environ.get("STEPPED_S", "0"))
    time.time = lambda: calendar_s() + ahead_s
    path, output, speed, *words = sys.argv[1:]
    asked = []
    signal.signal(signal.SIGTERM, lambda number, _: asked.append(number))
    job = Job(load_campaign(path), output, float(speed))
    supervision = Supervision(Printer().update, Printer().event, lambda: "stopped" if asked else None, lambda: False)
    outcome = (resume if words == ["resume"] else collect)(job, supervision).outcome
    print("end", outcome.ending.value, outcome.safe, flush=True)


main()
