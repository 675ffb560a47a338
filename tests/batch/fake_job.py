"""A job's process that needs no planfit and starts in no time: it does what the name of its job says."""

import json
import os
import signal
import sys
import time
from pathlib import Path

errand = json.loads(sys.stdin.readline())
job, own = errand["job"], Path(errand["out"]) / "batch"
with (own / "order.txt").open("a") as order:
    order.write(f"start {job['name']}\n")
tries = own / f"{job['name']}.tries"
number = int(tries.read_text()) + 1 if tries.exists() else 1
tries.write_text(str(number))
what = job["name"].partition("-")[0]
if what == "killed" or (what == "killedonce" and number == 1):
    os.kill(os.getpid(), signal.SIGKILL)
if what == "waits":
    sys.stdin.read()  # until it is closed
    (own / f"{job['name']}.left").touch()
    sys.exit(3)
time.sleep(0.5)
state = {
    "end": "refused" if what == "refused" else "done",
    "token": errand["token"],
    "reason": what,
}
state["peak_bytes"] = 10**9
(own / f"{job['name']}.json").write_text(json.dumps(state))
with (own / "order.txt").open("a") as order:
    order.write(f"end {job['name']}\n")
