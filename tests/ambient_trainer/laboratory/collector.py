"""``collect`` as a process of its own, on ports of a laboratory that lives elsewhere in fast time: it can be killed.

``collector.py CAMPAIGN.yaml TRACE.csv SPEED [resume]`` prints how many of its samples are on the disk, whenever that
changes, and what happens.
"""

import signal
import sys

from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.clock import FastClock
from ambient_trainer.laboratory.collect import Job, Watching, collect, resume


class Eyes:
    def __init__(self):
        self.told = 0

    def look(self, conductor):
        count = conductor.journal.samples_on_disk
        if count != self.told:
            self.told = count
            print("disk", count, flush=True)

    def say(self, at_s, text):
        print("said", f"{at_s:.0f}", text, flush=True)


def main():
    path, output, speed, *words = sys.argv[1:]
    asked = []
    signal.signal(signal.SIGTERM, lambda number, _: asked.append(number))
    job = Job(load_campaign(path), output, FastClock(float(speed)), float(speed))
    watching = Watching(Eyes(), lambda: "stopped" if asked else None, lambda: False)
    outcome = (resume if words == ["resume"] else collect)(job, watching).outcome
    print("end", outcome.ending.value, outcome.safe, flush=True)


main()
