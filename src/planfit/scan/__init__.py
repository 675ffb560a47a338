"""Posed RGB-D scans: the data type, one reader a format, and scans made of arrays."""

from planfit.scan.arrays import scan_from_arrays as scan_from_arrays
from planfit.scan.depth_checks import depth_of_nine as depth_of_nine
from planfit.scan.depth_checks import median_depth_m as median_depth_m
from planfit.scan.poses import read_tum as read_tum
from planfit.scan.poses import write_tum as write_tum
from planfit.scan.read import read_scan as read_scan
from planfit.scan.types import Label as Label
from planfit.scan.types import Scan as Scan
from planfit.scan.types import ScanFiles as ScanFiles
from planfit.scan.types import ScanOptions as ScanOptions
from planfit.scan.usable_frames import scan_from_recording as scan_from_recording
from planfit.scan.views import calibrated_scan as calibrated_scan
from planfit.scan.views import corrupt_frames as corrupt_frames
