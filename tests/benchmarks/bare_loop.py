"""The least that any such daemon does: read some files at deadlines, write one by rename. Nothing else is comparable.

Called with the rate in Hz, the file to write and the files to read; ends with a signal.
"""

import os
import sys
import time

rate_hz, target, *sources = sys.argv[1:]
descriptors = [os.open(source, os.O_RDONLY) for source in sources]
part = target + ".part"
due_s = time.clock_gettime(time.CLOCK_BOOTTIME)
while True:
    time.sleep(max(0.0, due_s - time.clock_gettime(time.CLOCK_BOOTTIME)))
    values = [int(os.pread(descriptor, 32, 0)) for descriptor in descriptors]
    written = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    os.write(written, b"%d\n" % values[0])
    os.close(written)
    os.rename(part, target)
    due_s += 1 / float(rate_hz)
