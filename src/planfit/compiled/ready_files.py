"""Files of compiled kernels: what they were compiled from, by and for, and one blob for each signature.

Two files: `kernels.bin`, the blobs one behind the other, and `index.json`, where each lies. The first line of
the index is the SHA-256 of what follows, and each blob has its own, so what is spoilt is not there at all.
Nothing but the standard library is needed here: the build of a wheel reads them without planfit.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

INDEX, BLOBS = "index.json", "kernels.bin"
_FORMAT = 1
"""Of both files; another one is not read."""


@dataclass(frozen=True)
class Made:
    """What kernels were compiled from, by and for; or what there is now, to compare with."""

    source: str
    """Digest of the sources that kernels depend on (`source_digest`)."""
    python: str
    """Interpreter and version, with the flags of its ABI: `cpython-311`."""
    numba: str
    """Version."""
    llvmlite: str
    """Version."""
    target: str
    """LLVM's triple of the system: `x86_64-unknown-linux-gnu`."""
    settings: str
    """Those of numba that change what is compiled."""
    cpu: str
    """Name of the CPU or of the level of CPUs."""
    features: tuple[str, ...]
    """Of the CPU: those that the code may use, or those that this machine has."""

    def misfit(self, here: "Made") -> str:
        """Why code made so cannot be taken `here`, in words for users; empty where it can."""
        words = {
            "source": "other sources of planfit than these",
            "python": f"{self.python}, found {here.python}",
            "numba": f"numba {self.numba}, found {here.numba}",
            "llvmlite": f"llvmlite {self.llvmlite}, found {here.llvmlite}",
            "target": f"{self.target}, found {here.target}",
            "settings": f"numba's settings {self.settings}, found {here.settings}",
        }
        for name, told in words.items():
            if getattr(self, name) != getattr(here, name):
                return f"made for {told}"
        lacking = sorted(set(self.features) - set(here.features))
        return (
            f"made for CPUs of {self.cpu}, this one lacks {', '.join(lacking)}" if lacking else ""
        )


def source_digest(package: Path) -> str:
    """SHA-256 of the Python sources that compiled code can depend on, by their places and their bytes.

    These are the modules with kernels and all that they import from the package, directly or not, since
    compiled code holds the values of constants that other modules define: an eighth of all files (50 ms).
    """
    sources = {path.relative_to(package): path.read_bytes() for path in package.rglob("*.py")}
    imports = re.compile(
        rf"^\s*from {package.name}\.([\w.]+) import (\([^)]*\)|[^\n]*)".encode(), re.MULTILINE
    )
    waiting = [place for place, data in sources.items() if b" import kernel\n" in data]
    needed: set[Path] = set()
    while waiting:
        place = waiting.pop()
        if place in needed or place not in sources:
            continue
        needed.add(place)
        for module, names in imports.findall(sources[place]):
            base = Path(*module.decode().split("."))
            waiting += [base.with_suffix(".py"), base / "__init__.py"]
            waiting += [base / f"{name}.py" for name in re.findall(r"\w+", names.decode())]
    digest = hashlib.sha256()
    for place in sorted(needed, key=lambda place: place.parts):
        digest.update(f"{place.as_posix()} {len(sources[place])}\n".encode())
        digest.update(sources[place])
    return digest.hexdigest()


@dataclass(frozen=True)
class Ready:
    """Compiled kernels in a folder."""

    folder: Path
    made: Made
    wheel_tag: str
    """Of a wheel that carries them: `cp311-cp311-manylinux_2_27_x86_64`."""
    places: Mapping[str, tuple[int, int, str]]
    """By kernel and signature, in a line of text: where its blob begins, its length in bytes, its SHA-256."""

    def blob(self, line: str) -> bytes | None:
        """What was kept of a kernel and signature; None where it was not, or is spoilt."""
        if line not in self.places:
            return None
        begin, length, digest = self.places[line]
        try:
            with (self.folder / BLOBS).open("rb") as file:
                file.seek(begin)
                blob = file.read(length)
        except OSError:
            return None
        return blob if hashlib.sha256(blob).hexdigest() == digest else None


def read_ready(folder: Path) -> Ready | str:
    """The kernels that a folder holds, or why there are none, in words for users."""
    try:
        told_digest, _, text = (folder / INDEX).read_bytes().partition(b"\n")
    except FileNotFoundError:
        return "none are here"
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    if hashlib.sha256(text).hexdigest().encode() != told_digest:
        return "their list is damaged"
    index: dict[str, Any] = json.loads(text)  # whole, so it is as `write_ready` left it
    if index["format"] != _FORMAT:
        return f"of format {index['format']}, this planfit reads {_FORMAT}"
    made = {field.name: index["made"][field.name] for field in fields(Made)}
    made["features"] = tuple(made["features"])
    places = {
        line: (begin, length, digest) for line, (begin, length, digest) in index["kernels"].items()
    }
    return Ready(folder, Made(**made), index["wheel_tag"], places)


def write_ready(folder: Path, made: Made, wheel_tag: str, blobs: Mapping[str, bytes]) -> None:
    """Put kernels into a folder, in the place of any that are there.

    Each file is replaced at once, the index last: who reads meanwhile finds blobs that the old index does not
    know, which are none.

    Raises:
        OSError: it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    places, begin = {}, 0
    for line, blob in sorted(blobs.items()):
        places[line] = (begin, len(blob), hashlib.sha256(blob).hexdigest())
        begin += len(blob)
    index = {"format": _FORMAT, "made": asdict(made), "wheel_tag": wheel_tag, "kernels": places}
    text = json.dumps(index, indent=1).encode()
    for name, parts in (
        (BLOBS, [blobs[line] for line in places]),
        (INDEX, [hashlib.sha256(text).hexdigest().encode(), b"\n", text]),
    ):
        part = folder / f"{name}.part"
        with part.open("wb") as file:
            file.writelines(parts)
        part.replace(folder / name)
