"""Write a synthetic scan to disk in the FACaP layout, with the truth beside it."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import cv2
import numpy as np

from planfit.errors import OptionError, OutputError
from planfit.runtime import whole_folder
from planfit.scan import write_tum
from planfit.scan.formats.facap import MASKS
from planfit.scan.images.files import write_image
from planfit.scan.poses import write_pose
from planfit.synth.building import facap_segments
from planfit.synth.scan import SyntheticScan


def write_facap(
    path: str | Path,
    synthetic: SyntheticScan,
    on_progress: Callable[[int, int], None] | None = None,
    n_threads: int = 2,
) -> None:
    """Write a folder that `planfit.read_scan` reads, with a `floorplan.npy` for `read_floorplan`.

    Beside it lies `groundtruth.tum`: true world_from_cam, the first column the frame number. Of several
    storeys there is `plan_0.npy` and so on instead, from the lowest, and `storeys.csv`: frame, storey (-1 on
    stairs), height of its floor, m.

    Raises:
        OptionError: the scan's world is moved against the plan.
        OutputError: the folder holds files, or cannot be written.
    """
    path = Path(path)
    scan = synthetic.scan
    if scan.plan_from_world_axes is None:
        raise OptionError(
            "world: expected 'plan', because the FACaP layout records poses in the plan's axes, "
            f"found {synthetic.options.world!r}"
        )
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise OutputError(f"{path}: expected an empty or new folder, found files in it")
    with whole_folder(path, "check rights and space") as folder:
        (folder / "arcore").mkdir()
        if scan.has_labels:
            (folder / "segmentation").mkdir()
        _write_plans(folder, synthetic)
        write_tum(folder / "groundtruth.tum", scan.timestamps, synthetic.true_world_from_cams)
        pool = ThreadPoolExecutor(n_threads)
        try:
            jobs = [pool.submit(_write_frame, folder, synthetic, i) for i in range(len(scan))]
            for done, job in enumerate(as_completed(jobs), start=1):
                job.result()
                if on_progress is not None:
                    on_progress(done, len(scan))
        finally:
            # On Ctrl-C, frames not yet begun are dropped.
            pool.shutdown(wait=True, cancel_futures=True)


def _write_plans(path: Path, synthetic: SyntheticScan) -> None:
    if len(synthetic.floorplans) == 1:
        np.save(path / "floorplan.npy", facap_segments(synthetic.floorplan))
        return
    for k, floorplan in enumerate(synthetic.floorplans):
        np.save(path / f"plan_{k}.npy", facap_segments(floorplan))
    lines = ["frame,storey,floor_z_m"]
    for name, storey in zip(synthetic.scan.frame_ids, synthetic.frame_storeys, strict=True):
        height = f"{synthetic.floors_z[storey]:.3f}" if storey >= 0 else ""
        lines.append(f"{name},{storey},{height}")
    (path / "storeys.csv").write_text("\n".join(lines) + "\n")


def _write_frame(path: Path, synthetic: SyntheticScan, frame_idx: int) -> None:
    scan = synthetic.scan
    name = scan.frame_ids[frame_idx]
    camera = scan.cameras[frame_idx]
    folder = path / "arcore"
    color = scan.files.color(frame_idx)
    if color is not None:
        color = cv2.cvtColor(color, cv2.COLOR_RGB2BGR)
        write_image(folder / f"frame-{name}.jpg", color, [cv2.IMWRITE_JPEG_QUALITY, 95])
    depth = scan.files.depth(frame_idx)
    millimetres = np.where(np.isfinite(depth), np.rint(np.nan_to_num(depth) * 1e3), 0)
    write_image(folder / f"depth-{name}.png", np.clip(millimetres, 0, 65534).astype(np.uint16), [])
    write_pose(folder / f"pose-{name}.txt", scan.world_from_cams[frame_idx])
    values = (camera.fx, camera.fy, camera.cx, camera.cy)
    (folder / f"cam_params-{name}.txt").write_text(
        f"{camera.width} {camera.height} " + " ".join(f"{v:.9g}" for v in values) + "\n"
    )
    if scan.has_labels:
        labels = scan.files.labels(frame_idx)
        for kind, label in MASKS.items():
            mask = np.rot90(np.where(labels == label, 255, 0).astype(np.uint8), -1)
            write_image(path / "segmentation" / f"frame-{name}_{kind}.png", mask, [])
