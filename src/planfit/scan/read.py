"""`read_scan`: from a path to a scan, whatever its format."""

from pathlib import Path

from planfit.errors import ScanError
from planfit.scan.facap import is_facap, read_facap
from planfit.scan.types import Scan


def read_scan(path: str | Path, use_masks: bool = True) -> Scan:
    """Read a posed RGB-D scan; the format is recognised by what lies in the folder.

    Args:
        path: folder of the scan.
        use_masks: whether floor and wall masks that lie beside the images are used.

    Raises:
        ScanError: the folder is missing, of an unknown layout, or its files cannot be used.
    """
    path = Path(path)
    if not path.exists():
        raise ScanError(f"{path}: expected the folder of a scan, found nothing; check the path")
    if not path.is_dir():
        raise ScanError(f"{path}: expected the folder of a scan, found a file")
    if is_facap(path):
        return read_facap(path, use_masks)
    raise ScanError(
        f"{path}: expected a scan in the FACaP layout (a folder arcore/ with frame-NNNN.jpg, "
        "depth-NNNN.png, pose-NNNN.txt, cam_params-NNNN.txt), found none; see docs/formats.md"
    )
