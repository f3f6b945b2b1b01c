"""A flood of connections by an unprivileged user costs no one else a tick."""

import json
import os
import sys

import pytest

from processes import is_listening

FLOODS = {
    "connections that are held": "held.append(connected())",
    "connections a second": "connected().close()",
    "readers that never read": "held.append(connected()); held[:] = held[-400:]",
    "half-open": "held.append(connected()); held[-1].shutdown(socket.SHUT_WR); held[:] = held[-400:]",
}
FLOOD = """
import os, socket, sys
os.setuid(65534)
def connected():
    made = socket.socket(socket.AF_UNIX)
    made.connect(sys.argv[1])
    return made
held = []
print("ready", flush=True)
while True:
    try:
        {}
    except OSError:
        pass
"""
FOR_S = 12.0


@pytest.mark.slow
@pytest.mark.skipif(os.getuid() != 0, reason="only root becomes another user")
@pytest.mark.parametrize("flood", FLOODS)
def test_ten_readers_miss_no_tick_and_newcomers_get_in(flood, public, model_file, zones, spawn, listen, until):
    path, status = f"{public}/s", f"{public}/status.json"
    run = ("run", "--model", model_file, "--sysfs-root", zones.root, "--rate", "10", "--publish")
    for output in (f"socket:{path}", f"status:{status}"):  # the other one nobody floods
        spawn([sys.executable, "-m", "ambientd", *run, output], stderr=None)
    until(lambda: is_listening(path) and os.path.exists(status))  # its file appears a moment before it accepts
    readers = [listen(path) for _ in range(5)]
    assert spawn([sys.executable, "-I", "-S", "-c", FLOOD.format(FLOODS[flood]), path]).stdout.readline()
    readers += [listen(path) for _ in range(5)]  # they come during the flood
    heard = [[] for _ in readers]
    first_s = None
    while first_s is None or heard[-1][-1] < first_s + FOR_S:
        for lines, times_s in zip(readers, heard):
            report = json.loads(lines.readline())
            times_s.append(report["time_s"])
        first_s = first_s or heard[-1][0]
    with open(status) as stream:
        beside = json.load(stream)["missed_ticks"]
    everyone = [times_s[times_s.index(first_s) :] for times_s in heard]
    count = min(map(len, everyone))
    assert count > 10
    # a busy machine costs both of them single ones
    assert report["missed_ticks"] <= beside + 1
    assert all(each[:count] == everyone[0][:count] for each in everyone), "someone lost a line"
