"""What is mutated: a small file or scan of every reader, by the writers of the tests, and real files.

The writers are not planfit's own: they follow the formats' documents.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fuzz.other_files import Make, other_files

ROOT = Path(__file__).parents[2]
sys.path[:0] = [
    str(ROOT / "tests"),
    str(ROOT / "tests" / "scan"),
    str(ROOT / "tests" / "floorplan"),
]
MAX_REAL_BYTES = 700_000
"""Of a real file: larger ones take seconds each, and their mutants are damaged in the same ways."""


@dataclass(frozen=True)
class Sample:
    """Something that planfit reads."""

    name: str
    kind: str
    """How it is read: `plan`, `scan`, `laser`, `poses`, `options`, `edits`, `calibration`, `record`,
    `points`, `marks`, `corrections`, `jobs`, `run`."""
    entry: str
    """What the reader is given, relative to the folder of the files."""
    files: dict[str, bytes]
    """By their paths in the folder."""


def all_samples(scratch: Path) -> list[Sample]:
    """Every sample that can be made here; what needs a library that is absent is left out, and told."""
    found = []
    for name, make in {**_plans(), **_scans(), **other_files()}.items():
        folder = scratch / name
        folder.mkdir(parents=True)
        try:
            kind, entry = make(folder)
        except ImportError as error:
            print(f"left out: {name} ({error})")
            continue
        found.append(Sample(name, kind, entry, _files(folder)))
    return [*found, *_real_plans(), *_bad_plans()]


def _files(folder: Path) -> dict[str, bytes]:
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def _plans() -> dict[str, Make]:
    import plan_files as w

    area, building = w.make_plan(n_rooms=2)

    def plan(name: str, write: Callable[[Path], object]) -> Make:
        def make(folder: Path) -> tuple[str, str]:
            write(folder / name)
            return "plan", name

        return make

    def floorplan_json(path: Path) -> None:
        from planfit.floorplan import Floorplan, write_floorplan_json

        write_floorplan_json(path, Floorplan.from_segments(building.faces.ends, name="plan"))

    return {
        "plan-dxf": plan("plan.dxf", lambda p: w.write_dxf(p, area)),
        "plan-dxf-hatch": plan("plan.dxf", lambda p: w.write_dxf(p, area, hatch=True)),
        "plan-svg": plan("plan.svg", lambda p: w.write_svg(p, area)),
        "plan-pdf": plan("plan.pdf", lambda p: w.write_pdf(p, area)),
        "plan-ifc": plan("plan.ifc", lambda p: w.write_ifc(p, area)),
        "plan-geojson": plan("plan.geojson", lambda p: w.write_geojson(p, area)),
        "plan-npy": plan("plan.npy", lambda p: np.save(p, building.faces.ends.reshape(-1, 4))),
        "plan-json": plan("plan.json", floorplan_json),
        "plan-png": plan("plan.png", lambda p: w.write_png(p, area, pixels_per_metre=12.0)),
        **{
            f"plan-{s}": plan(f"plan.{s}", _picture_writer(area))
            for s in ("jpg", "tif", "bmp", "pgm")
        },
        **{f"plan-{s}": plan(f"plan.{s}", _mesh) for s in _MESHES},
        "plan-ros": _ros_map,
        "plan-room": _room,
    }


_MESHES = ("ply", "obj", "glb", "stl", "off")


def _picture_writer(area: object) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        from PIL import Image

        import plan_files

        png = path.with_suffix(".png")
        plan_files.write_png(png, area, pixels_per_metre=12.0)
        Image.open(png).convert("L").save(path)
        png.unlink()

    return write


def _mesh(path: Path) -> None:
    """Four walls of a room."""
    import trimesh

    walls = [((4, 0.1, 2.6), (0, 0, 1.3)), ((4, 0.1, 2.6), (0, 3, 1.3)),
             ((0.1, 3, 2.6), (-2, 1.5, 1.3)), ((0.1, 3, 2.6), (2, 1.5, 1.3))]  # fmt: skip
    boxes = [trimesh.creation.box(size).apply_translation(centre) for size, centre in walls]
    trimesh.util.concatenate(boxes).export(path)


def _ros_map(folder: Path) -> tuple[str, str]:
    from test_ros_maps import cells_of_a_room, write_map

    path = write_map(folder, cells_of_a_room())
    return "plan", path.name


def _room(folder: Path) -> tuple[str, str]:
    from test_room_plan import a_room

    (folder / "Room.json").write_text(json.dumps(a_room()))
    return "plan", "Room.json"


def _scans() -> dict[str, Make]:
    import scan_samples as w

    sample = w.make_sample()

    def folder_scan(kind: str) -> Make:
        def make(folder: Path) -> tuple[str, str]:
            if kind == "record3d":
                w.write_record3d(folder / "scan.r3d", sample)
                return "scan", "scan.r3d"
            w.WRITERS[kind](folder / "scan", sample)
            return "scan", "scan"

        return make

    def colmap_binary(folder: Path) -> tuple[str, str]:
        w.write_colmap(folder / "scan", sample, binary=True)
        return "scan", "scan"

    def zipped(folder: Path) -> tuple[str, str]:
        w.write_tum(folder / "scan", sample)
        files = _files(folder)
        w.write_zip(folder / "scan.zip", files)
        for name in files:
            (folder / name).unlink()
        return "scan", "scan.zip"

    def rtabmap(folder: Path) -> tuple[str, str]:
        from rtabmap_writer import write_rtabmap

        write_rtabmap(folder / "map.db", sample)
        return "scan", "map.db"

    def sens(folder: Path) -> tuple[str, str]:
        from sens_writer import write_sens

        write_sens(folder / "scene.sens", sample)
        return "scan", "scene.sens"

    def bag(kind: str) -> Make:
        def make(folder: Path) -> tuple[str, str]:
            from bag_writer import BagWriter, write_images, write_tf

            ros, storage = {"ros1": (1, None), "sqlite": (2, "sqlite"), "mcap": (2, "mcap")}[kind]
            path = folder / ("scan.bag" if ros == 1 else "scan")
            writer = BagWriter(path, ros, storage)
            with writer.writer:
                write_images(writer, sample, "png")
                write_tf(writer, sample)
            return "scan", path.name

        return make

    def any_folder(kind: str) -> Make:
        def make(folder: Path) -> tuple[str, str]:
            import test_any_folders

            test_any_folders.ROWS[kind].write(folder / "scan", sample)
            return "scan", "scan"

        return make

    any_folders = ("poses as JSON", "EuRoC with depth", "poses and lenses by frame", "BundleSDF")
    return {
        **{f"scan-{kind}": folder_scan(kind) for kind in w.WRITERS},
        **{f"scan-any-{kind}": any_folder(kind) for kind in any_folders},
        "scan-facap": _facap,
        "scan-colmap-binary": colmap_binary,
        "scan-zip": zipped,
        "scan-rtabmap": rtabmap,
        "scan-sens": sens,
        **{f"scan-bag-{kind}": bag(kind) for kind in ("ros1", "sqlite", "mcap")},
        **{f"scan-{kind}": _laser(kind) for kind in ("las", "laz", "e57")},
    }


def _facap(folder: Path) -> tuple[str, str]:
    from planfit.synth import (
        BuildingOptions,
        CameraOptions,
        SynthOptions,
        WalkOptions,
        make_scan,
        write_facap,
    )

    options = SynthOptions(
        seed=5,
        building=BuildingOptions(n_rooms=2),
        walk=WalkOptions(n_frames=6),
        camera=CameraOptions(width_px=128, height_px=96),
    )
    write_facap(folder / "scan", make_scan(options))
    return "scan", "scan"


def _laser(kind: str) -> Make:
    def make(folder: Path) -> tuple[str, str]:
        import laser_scans as w

        walk = w.walk_in_a_room(per_second=700)
        if kind == "e57":
            w.write_e57(folder / "scan.e57", walk)
            (folder / "trajectory.txt").write_text("\n".join(w.tum_lines(walk)) + "\n")
        else:
            w.write_walk(folder, walk, f".{kind}")
        return "laser", f"scan.{kind}"

    return make


def _real_plans() -> Iterator[Sample]:
    """Plans that others made, where the shared data is at hand."""
    shared = os.environ.get("PLANFIT_SHARED")
    if not shared:
        print("left out: real plans (PLANFIT_SHARED is not set)")
        return
    from planfit.floorplan.formats import READERS

    for top in ("floorplans", "real_files"):
        for path in sorted((Path(shared) / top).rglob("*")):
            is_plan = path.suffix.lower() in READERS and not {
                "stray_scanner",
                "scanner3d_app",
                "record3d",
            } & set(path.parts)
            if path.is_file() and is_plan and path.stat().st_size <= MAX_REAL_BYTES:
                name = f"real-{path.parent.name}-{path.name}"
                files = {path.name: path.read_bytes()}
                for other in path.parent.glob("*.pgm" if path.suffix == ".yaml" else "NONE"):
                    files[other.name] = other.read_bytes()
                yield Sample(name, "plan", path.name, files)


def _bad_plans() -> Iterator[Sample]:
    """Files that broke a reader once."""
    for path in sorted((ROOT / "tests" / "data" / "bad_plans").iterdir()):
        yield Sample(f"bad-{path.name}", "plan", path.name, {path.name: path.read_bytes()})
