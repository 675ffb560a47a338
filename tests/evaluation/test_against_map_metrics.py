"""MME, MPV and MOM against the library published with MOM, map-metrics 0.0.4, on the same clouds.

It needs numpy below 2, which planfit does not run on, so an interpreter of its own is called:

    python -m venv FOLDER
    FOLDER/bin/pip install "numpy<2" "nptyping<2" "scikit-learn<1.6" networkx open3d-cpu
    FOLDER/bin/pip install --no-deps map-metrics==0.0.4
    PLANFIT_MAP_METRICS_PYTHON=FOLDER/bin/python pytest tests/evaluation/test_against_map_metrics.py
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from builders import look
from planfit.evaluation import MapSample, find_orthogonal_sets, map_quality, mom_m2
from planfit.geometry import se3

PYTHON = os.environ.get("PLANFIT_MAP_METRICS_PYTHON", sys.executable)
NEEDED = "import map_metrics.metrics, map_metrics.utils.orthogonal"
IS_INSTALLED = subprocess.run([PYTHON, "-c", NEEDED], capture_output=True).returncode == 0

pytestmark = pytest.mark.skipif(
    not IS_INSTALLED,
    reason="no map-metrics 0.0.4: PLANFIT_MAP_METRICS_PYTHON names no Python that has it",
)

PUBLISHED = """
import json, sys
import numpy as np
import open3d as o3d
from map_metrics.config import DepthConfig
from map_metrics.metrics import mme, mom, mpv
from map_metrics.utils.orthogonal import extract_orthogonal_subsets

data = np.load(sys.argv[1])
def cloud(points):
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
start, poses = data["start"], list(data["poses"])
clouds = [cloud(data["points"][a:b]) for a, b in zip(start[:-1], start[1:])]
map_from_first = np.linalg.inv(poses[0])
moms, own_moms = [], []
for i, pose in enumerate(poses):
    map_from_cam = map_from_first @ pose
    def placed(points):
        return np.asarray(cloud(points).transform(map_from_cam).points)
    sets = [placed(data[f"set_{i}_{k}"]) for k in range(3)]
    moms.append(float(mom(clouds, poses, orth_list=sets, config=DepthConfig)))
    own = [placed(s) for s in extract_orthogonal_subsets(clouds[i], config=DepthConfig, eps=0.1)[0]]
    own_moms.append(float(mom(clouds, poses, orth_list=own, config=DepthConfig)))
print(json.dumps({
    "mme": float(mme(clouds, poses, DepthConfig)),
    "mpv": float(mpv(clouds, poses, DepthConfig)),
    "mom": moms,
    "own_mom": own_moms,
}))
"""


def corner(rng: np.random.Generator, n: int, sigma_m: float) -> np.ndarray:
    """Three walls that meet, n points each, and clutter before them."""
    points = rng.uniform(0, 1.5, (3 * n, 3))
    for axis in range(3):
        points[axis * n : (axis + 1) * n, axis] = sigma_m * rng.normal(size=n)
    return np.concatenate([points, rng.uniform(0.3, 1.2, (n // 10, 3))])


@pytest.mark.parametrize("drift_m", [0.0, 0.03])
def test_the_published_library_gives_the_same(rng, tmp_path: Path, drift_m: float) -> None:
    eyes = [([1.2, 1.2, 1.1], 225), ([0.9, 1.1, 1.0], 220), ([1.1, 0.8, 1.2], 230)]
    true = np.stack([look(at, yaw) for at, yaw in eyes])
    clouds = [se3.transform(se3.inverse(pose), corner(rng, 300, 0.003)) for pose in true]
    sample = MapSample(np.concatenate(clouds).astype(np.float32), np.cumsum([0, *map(len, clouds)]))
    poses = true.copy()
    poses[:, :3, 3] += drift_m * np.arange(3)[:, None]

    sets = find_orthogonal_sets(sample, 0.2, max_frames=3)
    assert [of.frame_idx for of in sets] == [0, 1, 2]
    points = sample.points_cam.astype(float)
    arrays = {
        f"set_{of.frame_idx}_{k}": points[idx] for of in sets for k, idx in enumerate(of.sets)
    }
    np.savez(tmp_path / "clouds.npz", points=points, start=sample.start, poses=poses, **arrays)
    words = [PYTHON, "-c", PUBLISHED, str(tmp_path / "clouds.npz")]
    run = subprocess.run(words, check=True, capture_output=True, text=True)
    theirs = json.loads(run.stdout.splitlines()[-1])

    quality = map_quality(sample.at(poses), 0.2)
    assert quality.mme == pytest.approx(theirs["mme"], abs=1e-9)
    assert quality.mpv_m2 == pytest.approx(theirs["mpv"], rel=1e-9)
    assert mom_m2(sets, quality) == pytest.approx(np.mean(theirs["mom"]), rel=1e-5)
    # It chooses its own sets otherwise: normals of at most 30 neighbours, clustered by Ward's linkage.
    assert mom_m2(sets, quality) == pytest.approx(np.mean(theirs["own_mom"]), rel=0.1)
