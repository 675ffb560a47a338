"""What matching hands on: keypoints of a frame, relative poses of pairs, matches of a scan."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar, cast

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped, UInt8

from planfit.errors import ScanError
from planfit.runtime import StoredArray, let_go, short_repr


@dataclass(frozen=True)
class Detections:
    """Keypoints of one image, before their depth is looked up."""

    uv: Float32[np.ndarray, "k 2"]
    """px, sub-pixel."""
    scores: Float32[np.ndarray, " k"]
    """The larger the surer."""
    descriptors: Shaped[np.ndarray, "k d"]
    """Near in Euclidean distance where they show the same."""

    __repr__ = short_repr


Detector = Callable[[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"] | None], Detections]
"""Finds keypoints in a grey image; safe to call from several threads.

The second argument is 0 where keypoints are of no use, or None: those may be left out, which saves time,
and no other may change for it.
"""


@dataclass(frozen=True)
class Keypoints:
    """Keypoints of one frame that have a depth."""

    uv: Float32[np.ndarray, "k 2"]
    """px, sub-pixel."""
    points_cam: Float32[np.ndarray, "k 3"]
    """m, camera frame."""
    scores: Float32[np.ndarray, " k"]
    """How strong each is."""
    descriptors: Shaped[np.ndarray, "k d"]
    """Compared by Euclidean distance."""
    sharpness: Float32[np.ndarray, ""] | np.float32
    """Of the image."""

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.uv)


@dataclass(frozen=True)
class KeptKeypoints:
    """Keypoints of one frame as they are held for a whole scan: descriptors, five sixths of all, stay where
    they are stored until the frame is matched."""

    uv: Float32[np.ndarray, "k 2"]
    points_cam: Float32[np.ndarray, "k 3"]
    scores: Float32[np.ndarray, " k"]
    stored_descriptors: StoredArray
    sharpness: Float32[np.ndarray, ""] | np.float32

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.uv)

    def read(self) -> Keypoints:
        """With their descriptors.

        Raises:
            OutputError: what this run stored is gone.
        """
        descriptors = self.stored_descriptors.read()
        return Keypoints(self.uv, self.points_cam, self.scores, descriptors, self.sharpness)


Own = TypeVar("Own", bound="Rows")
OfPairs = TypeVar("OfPairs", bound="PairRows")


class Rows:
    """Of a dataclass whose fields are arrays with a row for each thing; None where nothing is known."""

    def _columns(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(cast(Any, self))}

    def __len__(self) -> int:
        return len(next(iter(self._columns().values())))

    def __getitem__(self: Own, idx: Shaped[np.ndarray, " k"]) -> Own:
        """Those that an index or a mask takes."""
        columns = self._columns().items()
        return type(self)(**{name: None if rows is None else rows[idx] for name, rows in columns})

    def then(self: Own, other: Own) -> Own:
        """These, then those of `other`; what is known of both."""
        both = [(name, rows, getattr(other, name)) for name, rows in self._columns().items()]
        return type(self)(
            **{
                name: None if a is None or b is None else np.concatenate([a, b])
                for name, a, b in both
            }
        )


class PairRows(Rows):
    """Rows that are sorted by pair of frames."""

    pairs: Int[np.ndarray, "p 2"]

    def joined(self: OfPairs, other: OfPairs) -> OfPairs:
        """These and those of `other`, sorted; a pair that both have stands twice."""
        both = self.then(other)
        return both[np.lexsort((both.pairs[:, 1], both.pairs[:, 0]))]

    def numbered(self: OfPairs, frame_idx: Int[np.ndarray, " k"]) -> OfPairs:
        """The same of a scan whose frames `frame_idx` these are."""
        return type(self)(**{**self._columns(), "pairs": frame_idx[self.pairs]})


Matcher = Callable[[Keypoints, Keypoints, tuple[int, int], tuple[int, int]], Int[np.ndarray, "m 2"]]
"""Tentative matches of two frames' keypoints, given width and height of both images in px."""


@dataclass(frozen=True)
class RelativePoses(Rows):
    """Edges of the pose graph: verified motions between frames, consecutive ones and loop closures."""

    pairs: Int[np.ndarray, "p 2"]
    """Frame indices."""
    a_from_b: Float[np.ndarray, "p 4 4"]
    """m, camera frame of the second of the pair to that of the first."""
    n_inliers: Int[np.ndarray, " p"]
    """Matches that agree with each."""
    explained: Float[np.ndarray, " p"] | None = None
    """How much of both views each explains (`view_agreement.py`); None where views were not compared."""

    __repr__ = short_repr


@dataclass(frozen=True)
class Matches:
    """Verified matches, the paper's set M, sorted by pair of frames."""

    pairs: Int[np.ndarray, "p 2"]
    """Frame indices, first < second."""
    start: Int[np.ndarray, " p+1"]
    """Matches of pair k are start[k]:start[k + 1]."""
    points_a: Float[np.ndarray, "m 3"]
    """m, camera frame of pairs[k, 0]; float32 as found by `find_matches`, like keypoints."""
    points_b: Float[np.ndarray, "m 3"]
    """m, camera frame of pairs[k, 1]."""
    sigma: Float[np.ndarray, " m"]
    """m, standard deviation of points_a - points_b, each axis."""
    n_tried: int
    """Pairs of frames that were tried."""
    n_keypoints: int
    """Keypoints with depth, over all frames."""
    explained: Float[np.ndarray, " p"] | None = None
    """How much of both views the motion of each pair explains, where views were compared."""

    __repr__ = short_repr

    @property
    def n_matches(self) -> int:
        """Number of verified matches."""
        return len(self.points_a)

    def n_loops(self, neighbours: int, keyframe_idx: Int[np.ndarray, " k"] | None = None) -> int:
        """Verified pairs that are further apart in time than `neighbours` frames, or keyframes."""
        return count_loops(self.pairs, neighbours, keyframe_idx)

    def numbered(self, frame_idx: Int[np.ndarray, " k"]) -> "Matches":
        """The same of a scan whose frames `frame_idx` these are."""
        return replace(self, pairs=frame_idx[self.pairs])

    def of_pairs(self, keep: Bool[np.ndarray, " p"]) -> "Matches":
        """Those of some pairs."""
        return self.taken(np.flatnonzero(keep))

    def taken(self, idx: Int[np.ndarray, " k"]) -> "Matches":
        """Those of the pairs `idx` (increasing), which cost no look at all the others."""
        ends = np.column_stack([self.start[idx], self.start[idx + 1]]).tolist()
        runs = [np.arange(first, last) for first, last in ends]
        of = np.concatenate([np.zeros(0, dtype=int), *runs])
        taken = replace(
            self,
            pairs=self.pairs[idx],
            start=np.cumsum([0, *map(len, runs)]),
            points_a=self.points_a[of],
            points_b=self.points_b[of],
            sigma=self.sigma[of],
            explained=None if self.explained is None else self.explained[idx],
        )
        if len(idx):
            span = slice(self.start[idx[0]], self.start[idx[-1] + 1])
            let_go(self.points_a[span])
            let_go(self.points_b[span])
        return taken

    @staticmethod
    def none() -> "Matches":
        """No matches at all."""
        none, nowhere = np.zeros(0), np.zeros((0, 3))
        pairs = np.zeros((0, 2), dtype=int)
        return Matches(pairs, np.zeros(1, dtype=int), nowhere, nowhere, none, 0, 0, none)

    def joined(self, other: "Matches") -> "Matches":
        """These and those of `other`, sorted by pair."""
        pairs = np.concatenate([self.pairs, other.pairs])
        order = np.lexsort((pairs[:, 1], pairs[:, 0]))
        sizes = np.concatenate([np.diff(self.start), np.diff(other.start)])
        # Where the matches of each pair begin among all of both, and then each of them in the new order.
        begin = np.cumsum(sizes) - sizes
        runs = [np.arange(int(begin[k]), int(begin[k] + sizes[k])) for k in order]
        taken = np.concatenate([np.zeros(0, dtype=int), *runs])
        explained = None
        if self.explained is not None and other.explained is not None:
            explained = np.concatenate([self.explained, other.explained])[order]
        return Matches(
            pairs=pairs[order],
            start=np.cumsum([0, *sizes[order]]),
            points_a=np.concatenate([self.points_a, other.points_a])[taken],
            points_b=np.concatenate([self.points_b, other.points_b])[taken],
            sigma=np.concatenate([self.sigma, other.sigma])[taken],
            n_tried=self.n_tried + other.n_tried,
            n_keypoints=self.n_keypoints + other.n_keypoints,
            explained=explained,
        )

    @staticmethod
    def from_arrays(
        frame_pairs: Int[np.ndarray, "m 2"],
        points_a: Float[np.ndarray, "m 3"],
        points_b: Float[np.ndarray, "m 3"],
        sigma: Float[np.ndarray, " m"] | float,
    ) -> "Matches":
        """Matches of one's own, one row each and in any order, instead of those that `find_matches` finds.

        They are taken as they are: nothing is verified.

        Args:
            frame_pairs: frames that the two points of a match were seen from, in either order.
            points_a: m, the point in the camera frame of the first frame.
            points_b: m, the same point in the camera frame of the second frame.
            sigma: m, standard deviation of points_a - points_b, each axis; one for all or one a match.

        Raises:
            ScanError: a number is not finite, a sigma not above 0, or a pair not of two frames.
        """
        sigmas = np.broadcast_to(np.asarray(sigma, dtype=float), (len(frame_pairs),)).copy()
        _check_matches(frame_pairs, points_a, points_b, sigmas)
        # The first frame of a pair is the smaller one: where it is not, the two ends change places.
        is_swapped = (frame_pairs[:, 0] > frame_pairs[:, 1])[:, None]
        points_a, points_b = (
            np.where(is_swapped, points_b, points_a).astype(float),
            np.where(is_swapped, points_a, points_b).astype(float),
        )
        # lexsort takes its last key first, and is stable: matches of a pair keep their order.
        ordered = np.sort(frame_pairs, axis=1)
        by_pair = np.lexsort((ordered[:, 1], ordered[:, 0]))
        pairs, counts = np.unique(ordered, axis=0, return_counts=True)
        return Matches(
            pairs=pairs.reshape(-1, 2),
            start=np.cumsum([0, *counts]),
            points_a=points_a[by_pair],
            points_b=points_b[by_pair],
            sigma=sigmas[by_pair],
            n_tried=len(pairs),
            n_keypoints=2 * len(points_a),
        )


def count_loops(
    pairs: Int[np.ndarray, "p 2"], neighbours: int, keyframe_idx: Int[np.ndarray, " k"] | None
) -> int:
    """Pairs further apart than so many frames; where only keyframes were looked at, than so many of these."""
    if keyframe_idx is not None:
        pairs = np.searchsorted(keyframe_idx, pairs)
    return int(np.sum(pairs[:, 1] - pairs[:, 0] > neighbours))


def _check_matches(
    frame_pairs: np.ndarray, points_a: np.ndarray, points_b: np.ndarray, sigma: np.ndarray
) -> None:
    m = len(frame_pairs)
    shapes = (frame_pairs.shape, points_a.shape, points_b.shape)
    if shapes != ((m, 2), (m, 3), (m, 3)):
        raise ScanError(
            f"matches: expected frame_pairs (m, 2), points_a and points_b (m, 3), found {shapes}"
        )
    if not (np.isfinite(points_a).all() and np.isfinite(points_b).all()):
        raise ScanError("matches: expected finite points, found NaN or infinity; leave those out")
    if not (np.isfinite(sigma).all() and (sigma > 0).all()):
        raise ScanError("matches: expected every sigma finite and above 0 m, found others")
    if (frame_pairs < 0).any() or (frame_pairs[:, 0] == frame_pairs[:, 1]).any():
        raise ScanError(
            "matches: expected pairs of two different frame indices, found a negative one or a frame "
            "with itself"
        )
