"""`planfit demo --view`: the whole way, then a page that can be corrected."""

import json
import re
import signal
import subprocess
import sys
import time
import urllib.request

import pytest

SMALL = (
    "--synth.walk.n-frames", "40", "--synth.camera.width-px", "160", "--synth.camera.height-px", "120",
)  # fmt: skip


@pytest.mark.slow
def test_demo_is_shown_and_ended_by_ctrl_c(tmp_path):
    command = [
        sys.executable, "-u", "-m", "planfit", "demo", "-o", str(tmp_path / "demo"), *SMALL,
        "--view", "--no-browser",
    ]  # fmt: skip
    log = tmp_path / "log"
    with log.open("w") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, text=True)
    try:
        end = time.monotonic() + 240
        while (found := re.search(r"http://127\.0\.0\.1:\d+/\S+", log.read_text())) is None:
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < end, log.read_text()
            time.sleep(0.2)
        with urllib.request.urlopen(found[0] + "state", timeout=30) as answer:
            assert json.load(answer)["frames"] == 40
        entry = json.dumps({"kind": "exclude_frames", "entry": {"frames": [[5, 6]]}}).encode()
        kind = {"Content-Type": "application/json"}
        request = urllib.request.Request(found[0] + "add", entry, kind)
        with urllib.request.urlopen(request, timeout=30) as answer:
            assert len(json.load(answer)["corrections"]) == 1
        process.send_signal(signal.SIGINT)
        assert process.wait(30) in (0, 1)  # what the verdict says, not that it was ended
    finally:
        process.kill()
        process.wait()
    assert "ended; corrections are in" in log.read_text()
    assert "exclude_frames" in (tmp_path / "demo" / "run" / "corrections.toml").read_text()
