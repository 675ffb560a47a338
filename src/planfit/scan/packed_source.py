"""Images within one file, as a `ImageSource`: what containers and databases share."""

from abc import ABC, abstractmethod
from pathlib import Path

from planfit.errors import ScanError
from planfit.scan.source import HEAD_BYTES, TAIL_BYTES


class PackedSource(ABC):
    """One file as a place where images lie, `folder/number`, each read alone: a container or a database."""

    path: Path
    kind: str
    """What the file is, for messages."""

    @abstractmethod
    def n_bytes(self, name: str) -> int:
        """Length of an image.

        Raises:
            ScanError: there is none of this name.
        """

    @abstractmethod
    def part(self, name: str, begin: int, count: int) -> bytes:
        """Some bytes of an image.

        Raises:
            ScanError: they cannot be read.
        """

    def read(self, name: str) -> bytes:
        """See `ImageSource`."""
        return self.part(name, 0, self.n_bytes(name))

    def ends(self, name: str) -> tuple[bytes, bytes]:
        """See `ImageSource`; the rest of the image stays on the disk."""
        length = self.n_bytes(name)
        tail = min(length, TAIL_BYTES)
        return self.part(name, 0, min(length, HEAD_BYTES)), self.part(name, length - tail, tail)

    def on_disk(self, name: str) -> Path:
        """See `ImageSource`; no image of these formats needs it."""
        raise ScanError(f"{self.path}: expected {name} as a file, found it in a {self.kind}")
