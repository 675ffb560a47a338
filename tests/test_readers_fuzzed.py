"""What `benchmarks/fuzz` found: each kind of mutant that broke a reader, as small as it can be made."""

import json
import warnings
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import shapely
from fuzz.other_files import other_files
from PIL import Image

from plan_files import write_ifc
from planfit.as_built.record import read_as_built
from planfit.batch.jobs import read_jobs
from planfit.cli.batch import columns
from planfit.cli.parser import read_options
from planfit.cli.run_record import cache_of, read_record
from planfit.errors import (
    MAX_MESSAGE,
    FloorplanError,
    OptionError,
    PlanfitError,
    ScanError,
    told_as,
)
from planfit.export.tables import to_toml
from planfit.floorplan import read_floorplan
from planfit.floorplan.vector.regions import faces_of_regions
from planfit.geometry.calibration import PARAMETERS, SensorCalibration
from planfit.geometry.camera import Camera
from planfit.lsq import read_g2o
from planfit.pipeline.options import RefineOptions
from planfit.scan import read_scan, scan_from_arrays
from planfit.scan.formats.las import LasFile
from planfit.scan.images.decode import decode_image, header_size
from planfit.scan.lens_file import take_calibration, write_calibration
from scan_samples import make_sample, png, write_redwood

CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)


def test_messages_are_one_line_of_bounded_length() -> None:
    error = FloorplanError(
        "plan.yaml: expected a number, found " + "A" * 90_000 + "; export it again"
    )
    assert MAX_MESSAGE <= len(str(error)) < MAX_MESSAGE + 10
    assert str(error).startswith("plan.yaml: expected")
    assert str(error).endswith("; export it again")
    assert str(ScanError("found\n  a table\x1b[31m")) == "found   a table\\x1b[31m"
    assert str(PlanfitError()) == ""


def test_an_error_that_cannot_say_what_it_is_is_told_by_its_name(tmp_path: Path) -> None:
    class Mute(Exception):
        def __str__(self) -> str:
            return b"\xfc".decode()  # as those of OpenUSD, which repeat bytes of the file

    with (
        pytest.raises(FloorplanError, match=r"cannot be read \(Mute\)"),
        told_as(FloorplanError, tmp_path, "a room"),
    ):
        raise Mute


@pytest.mark.parametrize("name", ["scan.zip", "scan.r3d"])
@pytest.mark.parametrize("what", ["version", "letters"])
def test_directories_of_archives(what: str, name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("rgb\u00e4.txt", "x" * 100)
    data = bytearray(path.read_bytes())
    entry = data.rindex(b"PK\x01\x02")
    if what == "version":
        data[entry + 6] = 148  # needed to extract: 14.8
    else:
        data[entry + 49] = 0xFF  # a byte of the name that is no UTF-8
    path.write_bytes(bytes(data))
    with pytest.raises(ScanError, match=r"expected (a zip archive|a scan)"):
        read_scan(path)


@pytest.mark.parametrize("number", ["inf", "nan", "1e999"])
def test_numbers_of_frames_that_are_none(number: str, tmp_path: Path) -> None:
    write_redwood(tmp_path, make_sample())
    log = tmp_path / "trajectory.log"
    log.write_text(number + log.read_text()[1:])
    with pytest.raises(ScanError, match=r"trajectory\.log: expected blocks"):
        read_scan(tmp_path)


def test_images_cut_in_their_header(tmp_path: Path) -> None:
    whole = png(np.zeros((4, 4), np.uint8))
    assert header_size(whole, tmp_path) == (4, 4)
    for n in range(24):
        with pytest.raises(ScanError, match="expected an image"):
            header_size(whole[:n], tmp_path)


def chunk_that_claims(length: int) -> bytes:
    """A PNG whose pixels are said to take so many bytes."""
    whole = png(np.zeros((4, 4), np.uint8))
    at = whole.index(b"IDAT") - 4
    return whole[:at] + length.to_bytes(4, "big") + whole[at + 4 :]


def jpeg_that_claims(width: int, height: int) -> bytes:
    whole = cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8))[1].tobytes()
    at = whole.index(b"\xff\xc0") + 5
    return whole[:at] + height.to_bytes(2, "big") + width.to_bytes(2, "big") + whole[at + 4 :]


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (jpeg_that_claims(30_000, 30_000), "at most 100,000,000 pixels"),  # 5 GB, 23 s
        (jpeg_that_claims(65_000, 65_000), "at most 100,000,000 pixels"),  # an assertion of OpenCV
        (jpeg_that_claims(11_000, 10_000), "at most 100,000,000 pixels"),
        (chunk_that_claims(2_919_243_776), "a whole PNG, found .* where 2,919,243,776"),  # 2.7 GB
    ],
)
def test_images_that_claim_gigabytes(image: bytes, words: str, tmp_path: Path) -> None:
    with (
        warnings.catch_warnings(action="ignore", category=Image.DecompressionBombWarning),
        pytest.raises(ScanError, match=words),
    ):
        decode_image(image, tmp_path, cv2.IMREAD_COLOR)


def test_images_that_claim_what_they_have(tmp_path: Path) -> None:
    assert decode_image(jpeg_that_claims(16, 16), tmp_path, cv2.IMREAD_COLOR).shape == (16, 16, 3)
    whole = png(np.zeros((4, 4), np.uint8))
    length = whole.index(b"IEND") - whole.index(b"IDAT") - 12
    assert decode_image(chunk_that_claims(length), tmp_path, -1).shape == (4, 4)


@pytest.mark.parametrize("quaternion", ["0 0 0 0", "1e-320 0 0 0", "0 1e308 0 1e308", "0 0 nan 1"])
def test_quaternions_of_no_length(quaternion: str, tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text(f"VERTEX_SE3:QUAT 0 0 0 0 {quaternion}\n")
    with pytest.raises(PlanfitError, match=r"graph\.g2o:1: .* a quaternion that is not zero"):
        read_g2o(path)


def test_an_empty_name_in_an_archive(tmp_path: Path) -> None:
    path = tmp_path / "scan.r3d"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata", "{}")
    path.write_bytes(path.read_bytes().replace(b"metadata", b"\x00etadata"))
    with pytest.raises(ScanError):
        read_scan(path)


@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "1" + "0" * 400, '"2"'])
def test_options_that_are_no_numbers(value: str, tmp_path: Path) -> None:
    path = tmp_path / "options.toml"
    path.write_text(f"[adjust.walls]\nweight = {value}\n")
    with pytest.raises(OptionError, match=r"options\.toml: adjust: walls: weight: expected float"):
        read_options(path, RefineOptions())


def test_infinite_defaults_may_be_written_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "options.toml"
    path.write_text(to_toml(RefineOptions()))
    assert read_options(path, RefineOptions()) == RefineOptions()


def test_deep_toml_and_json_and_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text(f"x = {'[' * 5000}")
    with pytest.raises(OptionError, match="expected TOML"):
        read_options(path, RefineOptions())
    scan = scan_from_arrays(None, np.ones((2, 24, 32)), CAMERA, np.tile(np.eye(4), (2, 1, 1)))
    path.write_text("[" * 100_000)
    with pytest.raises(ScanError, match="found no JSON"):
        take_calibration(scan, path)
    path.write_bytes(b"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 \xd5")
    with pytest.raises(PlanfitError, match="expected text in g2o's format"):
        read_g2o(path)


def test_a_calibration_that_leaves_no_camera(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    write_calibration(path, SensorCalibration(), dict.fromkeys(PARAMETERS, 0.0), CAMERA)
    content = json.loads(path.read_text())
    content["parameters"]["principal_x"] = 1e308
    content["parameters"]["focal_scale"] = 1e308
    path.write_text(json.dumps(content))
    scan = scan_from_arrays(None, np.ones((2, 24, 32)), CAMERA, np.tile(np.eye(4), (2, 1, 1)))
    with pytest.raises(ScanError, match="calibration"), np.errstate(over="ignore"):
        take_calibration(scan, path)


def test_walls_larger_than_the_earth(tmp_path: Path) -> None:
    ring = [[11.57, 48.14], [11.5701, 48.14], [1e308, 48.1401], [11.57, 48.1401], [11.57, 48.14]]
    feature = {
        "type": "Feature",
        "properties": {"category": "wall"},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    path = tmp_path / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    with pytest.raises(FloorplanError, match=r"cannot be read|expected"), np.errstate(all="ignore"):
        read_floorplan(path)
    with pytest.raises(ValueError, match=r"coordinates of up to 1e\+20"):
        faces_of_regions(shapely.box(0, 0, 1e20, 1), 0.005, 0.03)


@pytest.mark.parametrize("kind", ["wall", "room"])
def test_maps_with_rings_of_any_size(kind: str, tmp_path: Path) -> None:
    box = [[11.57, 48.14], [11.5701, 48.14], [11.5701, 48.1401], [11.57, 48.1401], [11.57, 48.14]]
    features = [
        {
            "type": "Feature",
            "properties": {"category": kind},
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }
        for ring in (box, [[x * 1e18, y * 1e18] for x, y in box])
    ]
    path = tmp_path / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with pytest.raises(FloorplanError, match=r"coordinates of up to 4\.81e\+19"):
        read_floorplan(path)


@pytest.mark.parametrize(("name", "value"), [("width", 0), ("fx", -1.0), ("fx", 10**400)])
def test_cameras_of_a_calibration_that_are_none(name: str, value: float, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    write_calibration(path, SensorCalibration(), dict.fromkeys(PARAMETERS, 0.0), CAMERA)
    content = json.loads(path.read_text())
    content["camera"][name] = value
    path.write_text(json.dumps(content))
    scan = scan_from_arrays(None, np.ones((2, 24, 32)), CAMERA, np.tile(np.eye(4), (2, 1, 1)))
    with pytest.raises(ScanError, match="camera"):
        take_calibration(scan, path)


@pytest.mark.parametrize("suffix", [".ifc", ".ifczip"])
def test_a_schema_of_any_length(suffix: str, tmp_path: Path) -> None:
    pytest.importorskip("ifcopenshell")
    text = f"ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC{'9' * 400}'));\nENDSEC;\nDATA;\nENDSEC;\n"
    path = tmp_path / f"plan{suffix}"
    if suffix == ".ifc":
        path.write_text(text)
    else:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("plan.ifc", text)
    with pytest.raises(FloorplanError, match="a schema whose name has 403 letters"):
        read_floorplan(path)


@pytest.mark.parametrize(
    ("schemas", "words"),
    [
        ("FILE_SCHEMA(('IFC4'));\nFILE_SCHEMA(('IFC4'));", "a header with 2 schemas"),
        (f"FILE_SCHEMA(st1+b{'9' * 4000}','');", "a header whose schema has no name"),
        ("FILE_SCHEMA(('IFC4'", "a header whose schema has no name"),
    ],
)
def test_a_header_that_a_library_dies_of(schemas: str, words: str, tmp_path: Path) -> None:
    pytest.importorskip("ifcopenshell")
    path = tmp_path / "plan.ifc"
    path.write_text(f"ISO-10303-21;\nHEADER;\n{schemas}\nENDSEC;\nDATA;\nENDSEC;\n")
    with pytest.raises(FloorplanError, match=words):
        read_floorplan(path)


def test_walls_along_lines_without_points(tmp_path: Path) -> None:
    """Points that a damaged file lacks: the library divides by their number."""
    pytest.importorskip("ifcopenshell")
    path = write_ifc(
        tmp_path / "plan.ifc", shapely.box(0, 0, 6, 4).difference(shapely.box(1, 1, 5, 3))
    )
    lines = path.read_text().splitlines()
    kept = [line for line in lines if "IFCCARTESIANPOINT((" not in line or line.count(",") == 2]
    assert len(kept) < len(lines)
    path.write_text("\n".join(kept))
    with pytest.raises(FloorplanError, match="an IfcPolyline without points"):
        read_floorplan(path)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A whole `run.json`, as the fuzzer has it."""
    folder = tmp_path_factory.mktemp("run")
    other_files()["run-json"](folder)
    assert read_record(folder).n_frames == 6
    return json.loads((folder / "run.json").read_text())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("options", "x"),
        ("options", {"adjust": {"walls": "x"}}),
        ("frames", float("inf")),
        ("world_from_plan", [[10**400] * 4] * 4),
        ("plan_from_world_before", [[float("nan")] * 4] * 4),
        ("alignment", {"metres_per_unit_xy": ["a", "b"]}),
        ("alignment", {"metres_per_unit_xy": [float("inf"), 1.0]}),
        ("corrections", {"toml": 1.5}),
        ("scan_options", 3),
        ("sensor", {"correction": {"depth_scale": "2", "unknown": 1}}),
    ],
)
def test_records_of_runs_with_other_values(
    key: str, value: Any, record: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "run.json").write_text(json.dumps(record | {key: value}))
    with pytest.raises(ScanError, match=r"run\.json: expected the record of a run of this version"):
        read_record(tmp_path)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "{", "\xff"])
def test_records_of_runs_that_are_no_json(text: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(
        ScanError, match=r"run\.json: expected the record of a run, found a damaged"
    ):
        read_record(tmp_path)
    with pytest.raises(
        ScanError, match=r"run\.json: expected the record of a run, found a damaged"
    ):
        cache_of(tmp_path)


@pytest.mark.parametrize("scans", ["x", 3, [None, "x", 4], [{"folder": 5}], {"folder": "a"}])
def test_records_of_runs_of_several_scans_that_name_none(
    scans: Any, record: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "run.json").write_text(json.dumps(record | {"scans": scans}))
    if isinstance(scans, list):
        with pytest.raises(ScanError, match="found one of several"):
            read_record(tmp_path)
    else:
        assert read_record(tmp_path).n_frames == 6


def test_deep_jobs_and_walls_as_built(tmp_path: Path) -> None:
    (tmp_path / "jobs.json").write_text("[" * 100_000)
    with pytest.raises(OptionError, match=r"jobs\.json: expected JSON"):
        read_jobs(tmp_path / "jobs.json", columns())
    (tmp_path / "as_built.json").write_text("[" * 100_000)
    with pytest.raises(ScanError, match=r"as_built\.json: expected the walls"):
        read_as_built(tmp_path)


@pytest.mark.parametrize(("at", "words"), [(100, "records of variable"), (243, "extended records")])
def test_laser_scans_that_count_more_records_than_bytes(
    at: int, words: str, tmp_path: Path
) -> None:
    laspy = pytest.importorskip("laspy", reason="laspy is not installed (planfit[laser])")
    header = laspy.LasHeader(point_format=6, version="1.4")
    laspy.LasData(header).write(tmp_path / "scan.las")
    data = bytearray((tmp_path / "scan.las").read_bytes())
    assert LasFile(tmp_path / "scan.las").n_points == 0
    data[at : at + 4] = (1_374_486_529).to_bytes(4, "little")  # laspy reads for minutes
    (tmp_path / "scan.las").write_bytes(data)
    with pytest.raises(ScanError, match=f"found 1,374,486,529 {words}"):
        _ = LasFile(tmp_path / "scan.las").header


def test_faces_know_the_wall_behind_them_thin_or_as_thick_as_the_plan() -> None:
    """What is behind a face is looked for near it first, and through the whole plan where it goes on."""
    thin, block = shapely.box(0, 0, 100, 0.2), shapely.box(20, 10, 60, 70)
    faces = faces_of_regions(shapely.union_all([thin, block]), 0.01, 0.5)
    lengths = np.linalg.norm(faces.ends[:, 1] - faces.ends[:, 0], axis=1)
    found = {
        round(length): thickness for length, thickness in zip(lengths, faces.thickness, strict=True)
    }
    assert found[100] == pytest.approx(0.2, abs=1e-3)
    assert found[40] == pytest.approx(60.0, abs=1e-3)
    assert found[60] == pytest.approx(40.0, abs=1e-3)
