"""Where embree has no wheel, synthetic scans are refused in one line and all else works."""

import subprocess
import sys
from pathlib import Path

CODE = """
import sys
class Absent:
    def find_spec(self, name, *_):
        if name.startswith("embreex"):
            raise ImportError("No module named 'embreex'")
sys.meta_path.insert(0, Absent())
import planfit.cli.refine, planfit.cli.align, planfit.cli.evaluate, planfit.synth
from planfit.cli import main
main(["synth", {folder!r}, "--walk.n-frames", "2"])
"""


def test_refine_is_there_and_synth_says_what_it_lacks(tmp_path: Path) -> None:
    code = CODE.format(folder=str(tmp_path / "scan"))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2
    (line,) = [one for one in done.stderr.splitlines() if one.startswith("planfit: ")]
    assert "expected the library embreex" in line
    assert "All else of planfit works without it" in line
    assert not list(tmp_path.iterdir())
