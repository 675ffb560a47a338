"""A path that holds no scan: what it most likely is instead, and what to do."""

from pathlib import Path

from planfit.errors import ScanError
from planfit.findings.finding import FEW_NAMED
from planfit.scan.formats import READERS, whole_files
from planfit.scan.layout import FolderLayout
from planfit.scan.source import FileSource, FolderSource
from planfit.scan.tables import has_part

LOOK_AT = 200
"""So many things in a folder are looked at in search of a scan."""
ALIKE = (
    ("color", "rgb", "image", "images", "colour", "frames", "cam0"),
    ("depth", "depths", "depth_images", "aligned_depth"),
    ("pose", "poses"),
)
"""Names that folders of the same content have in programs of others."""

_MESH = (
    "a model or a cloud without its frames",
    "give the frames that it was made from (depth and poses: the app's raw data or developer export)",
)
_POSES = ("a list, of poses perhaps", "give the scan, and poses beside it with --poses FILE")
_PLAN = (
    "what may be a plan",
    "give the scan first: 'planfit refine SCAN FILE -o OUT'; 'planfit plan FILE' shows what is read of it",
)
_VIDEO = (
    "a video alone",
    "give depth and poses too: record with an app that keeps them (Stray Scanner, Record3D, Polycam's raw "
    "data)",
)
FOREIGN = {
    **dict.fromkeys(
        (".ply", ".obj", ".glb", ".gltf", ".fbx", ".stl", ".pcd", ".xyz", ".pts", ".ptx"), _MESH
    ),
    **dict.fromkeys((".txt", ".csv", ".log", ".tum"), _POSES),
    **dict.fromkeys(
        (".dxf", ".dwg", ".pdf", ".svg", ".ifc", ".ifczip", ".usdz", ".geojson", ".npy"), _PLAN
    ),
    **dict.fromkeys((".mp4", ".mov", ".avi"), _VIDEO),
    ".json": (
        "a single file of JSON",
        "give the folder that it belongs to; if it is a plan of RoomPlan, 'planfit plan FILE' reads it",
    ),
    ".mkv": (
        "a video or an Azure Kinect recording",
        "export colour, depth registered to it and poses (Open3D, or a ROS bag), and give that",
    ),
    ".depth": ("depth of Record3D without its metadata", "give the .r3d file, or all that it unpacks to"),
    ".svo": ("a ZED recording", "export it with poses, as a ROS bag or as images in the layout of TUM"),
    ".svo2": ("a ZED recording", "export it with poses, as a ROS bag or as images in the layout of TUM"),
    ".oni": ("an OpenNI recording", "export images and poses in the layout of TUM"),
    ".klg": ("a Logger recording of Kintinuous", "export images and poses in the layout of TUM"),
    **dict.fromkeys(
        (".rar", ".7z", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".zst"),
        ("a packed archive of another kind", "unpack it and give the folder, or pack it as zip"),
    ),
    **dict.fromkeys(
        (".jpg", ".jpeg", ".png", ".heic", ".tif", ".tiff"),
        (
            "a picture",
            "give the folder of the scan; if it is a plan, 'planfit plan FILE' shows what is read of it",
        ),
    ),
}  # fmt: skip
"""By the ends of names: what a file that is no scan is, and the next step."""


def no_scan_in_file(path: Path, layouts: dict[str, FolderLayout]) -> ScanError:
    """The error for a file that is neither an archive nor of a format of single files.

    `path`: the file; `layouts`: formats of folders, by name.
    """
    begin = (
        f"{path}: expected the folder of a scan, a zip archive of one, a bag or a database, found"
    )
    owner = FolderSource(path.resolve().parent)
    kind = _kind_of(owner, layouts)
    if kind:
        return ScanError(f"{begin} a file of a {kind} scan; give its folder, {owner.path}")
    what, step = FOREIGN.get(
        path.suffix.lower(), ("a file", "'planfit help scan-formats' lists what is read")
    )
    return ScanError(f"{begin} {what}; {step}")


def no_scan_in_folder(source: FileSource, layouts: dict[str, FolderLayout]) -> ScanError:
    """The error for a folder, or an archive, of no known layout.

    `source`: the files; `layouts`: formats of folders, by name.
    """
    begin = f"{source.path}: expected a scan, found"
    owner = folder_of_scan(source, layouts)
    if owner:
        return ScanError(f"{begin} a folder of a {owner[1]} scan; give {owner[0]}")
    inside = _scans_inside(source, layouts)
    if inside:
        named = ", ".join(f"{path} ({kind})" for path, kind in inside[:FEW_NAMED])
        more = f" and {len(inside) - FEW_NAMED} more" if len(inside) > FEW_NAMED else ""
        which = "one of them" if len(inside) > 1 else "it"
        return ScanError(f"{begin} a folder that holds {named}{more}; give {which}")
    near = nearest(source, layouts)
    if near:
        name, missing, renamed = near
        verb = "is" if len(missing) == 1 else "are"
        lacking = ", ".join(part.replace("|", " or ") for part in missing)
        steps = [f"rename {old}/ to {new}" for old, new in renamed]
        if any(part.startswith("depth") and part.endswith("/") for part in missing):
            steps.append("planfit needs depth of every frame")
        elif missing:
            steps.append(
                "add what is missing" if renamed else "copy or export the scan again, whole"
            )
        if not any(has_part(source, part) for part in layouts[name].parts if part[-1] != "/"):
            steps.append(
                "or, of another program, say --format any-folder, with --poses FILE where poses lie elsewhere"
            )
        of_which = f", of which {lacking} {verb} missing" if missing else ""
        much = "most" if 2 * len(missing) <= len(layouts[name].parts) else "a part"
        return ScanError(
            f"{begin} {much} of one of the format {name}{of_which}; it is told by "
            f"{layouts[name].expects}: {', '.join(steps)}"
        )
    held, step = _held(source)
    formats = f"'planfit help scan-formats' describes what is read: {', '.join(READERS)}"
    return ScanError(f"{begin} {held}; {step or formats}")


def is_of_known(source: FileSource, layouts: dict[str, FolderLayout]) -> bool:
    """Whether a folder holds scans of known formats, or is a copy of one that lacks files.

    A copy is told by another file of the format, or by the folder of the file that is missing.
    """
    if any(path.is_dir() for path, _ in _scans_inside(source, layouts)):
        return True
    near = nearest(source, layouts)
    files = [part for part in near[1] if not part.endswith("/")] if near else []
    if not near or not files:
        return False
    there = (part for part in layouts[near[0]].parts if part[-1] != "/" and has_part(source, part))
    folders = (part.rpartition("/")[0] for part in files)
    return any(there) or any(folder and source.names(folder) for folder in folders)


def nearest(
    source: FileSource, layouts: dict[str, FolderLayout]
) -> tuple[str, list[str], list[tuple[str, str]]] | None:
    """The format most of whose parts are there, which are not, and which only have another name (with that
    name first); None where none is near."""
    found = []
    for name, layout in layouts.items():
        lacking = [part for part in layout.parts if not has_part(source, part)]
        others = {part: _other_name(source, part, layout.parts) for part in lacking}
        renamed = [(other, part.split("|")[0]) for part, other in others.items() if other]
        missing = [part for part in lacking if not others[part]]
        n_there = len(layout.parts) - len(lacking)
        is_near = 2 * len(missing) <= len(layout.parts) and n_there
        # Images and depth in folders of their own are a scan's, whatever it lacks.
        is_alike = n_there + len(renamed) >= 2 and has_part(source, "depth/")
        if lacking and (is_near or is_alike):
            n_parts = len(layout.parts)
            # Files tell more than folders, which many formats have in common.
            n_files = sum(not p.endswith("/") for p in layout.parts if p not in lacking)
            found.append((len(missing), len(renamed), -n_files, -n_parts, name, missing, renamed))
    if not found:
        return None
    *_, name, missing, renamed = min(found)
    return name, missing, renamed


def _other_name(source: FileSource, part: str, parts: tuple[str, ...]) -> str:
    """The folder that holds what a part of a format does, by its name; empty where none does."""
    group = next((names for names in ALIKE if part.endswith("/") and part[:-1] in names), ())
    taken = {one for other in parts for one in other.split("|")}
    return next((n for n in source.folders() if n in group and f"{n}/" not in taken), "")


def folder_of_scan(source: FileSource, layouts: dict[str, FolderLayout]) -> tuple[Path, str] | None:
    """The scan that a folder of this disk is part of, and what it is; None where it is of none."""
    if not isinstance(source, FolderSource):
        return None
    parent = FolderSource(source.path.resolve().parent)
    try:
        kind = _kind_of(parent, layouts)
    except OSError:  # not to be looked into
        return None
    return (parent.path, kind) if kind else None


def _kind_of(source: FileSource, layouts: dict[str, FolderLayout]) -> str:
    """The format of a folder; empty where it is no scan."""
    return next((name for name, layout in layouts.items() if layout.recognise(source)), "")


def _scans_inside(source: FileSource, layouts: dict[str, FolderLayout]) -> list[tuple[Path, str]]:
    """Scans that lie in a folder of this disk, and what they are."""
    if not isinstance(source, FolderSource):
        return []
    found = []
    for path in sorted(source.path.iterdir())[:LOOK_AT]:
        kind = ""
        if path.is_dir():
            kind = _kind_of(FolderSource(path), layouts)
        elif path.suffix.lower() in (".zip", ".r3d"):
            kind = "archive"
        kind = kind or next((name for name, m in whole_files().items() if m.claims(path)), "")
        if kind:
            found.append((path, kind))
    return found


def _held(source: FileSource) -> tuple[str, str]:
    """What lies in a folder, and the next step where that tells it."""
    names = source.names()
    ends = [Path(name).suffix.lower() for name in names]
    n_pictures = sum(end in (".jpg", ".jpeg", ".png", ".heic") for end in ends)
    if n_pictures and n_pictures == len(names) and not source.folders():
        pictures = "a picture" if n_pictures == 1 else f"{n_pictures} pictures"
        return f"{pictures}, and neither depth nor poses", _VIDEO[1]
    telling = (_MESH, _VIDEO, FOREIGN[".depth"])
    told = next(((end, FOREIGN[end]) for end in ends if FOREIGN.get(end) in telling), None)
    if told is not None:
        end, (what, step) = told
        return f"{what} ({names[ends.index(end)]})", step
    if names or source.folders():
        return "none", ""
    if isinstance(source, FolderSource):
        return "an empty folder", ""
    return "none of this name in the archive", "check the path"
