"""Retrieval of frames that show the same: VLAD descriptors of frames, over those of their keypoints.

A frame is described by how its descriptors lie about each word of a small vocabulary learned from the
scan itself (Jegou, Douze, Schmid and Perez 2010), with residuals normalised word by word (Arandjelovic
and Zisserman 2013). Two frames are as alike as the scalar product of theirs.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Float32, Int, Shaped

from planfit.runtime import StoredArray

_N_WORDS = 48
N_SAMPLES = 8_000
"""Descriptors that the vocabulary is learned from."""
_N_PER_FRAME = 400
"""Descriptors of a frame that count, the first of it; more change the frame's descriptor little."""
_DIMENSIONS = 512
"""Frame descriptors are projected to this many numbers; a random projection keeps scalar products to 4 %."""
BLOCK = 256
N_LOOKED_AT = 64
"""The nearest or most similar views of each, of which the possible ones are taken: many visits fit in."""


def describe_frames(
    descriptors: Sequence[Shaped[np.ndarray, "_ d"] | StoredArray], rng: np.random.Generator
) -> Float32[np.ndarray, "n 512"]:
    """Unit descriptors of frames from those of their keypoints; 0 where a frame has none.

    Those that are stored are read, twice, a few frames at a time.
    """
    n = len(descriptors)
    dims = descriptors[0].shape[1] if n else 0
    some = [i for i in range(n) if len(descriptors[i])]
    described = np.zeros((n, _DIMENSIONS), dtype=np.float32)
    if not some:
        return described
    each = max(1, N_SAMPLES // len(some))
    sampled = some if len(some) <= N_SAMPLES else rng.choice(some, N_SAMPLES, replace=False)
    samples = np.concatenate(
        [_prepared(descriptors[i][rng.permutation(len(descriptors[i]))[:each]]) for i in sampled]
    )
    if len(samples) < 2 * _N_WORDS:  # too few for a vocabulary
        return described
    words = _vocabulary(samples, rng)
    projection = rng.normal(size=(_N_WORDS * dims, _DIMENSIONS)).astype(np.float32)
    for first in range(0, len(some), 64):  # all frames at once take w * d * 4 bytes each, 25 KB
        part = some[first : first + 64]
        vlad = np.stack([_vlad(_prepared(descriptors[i][:_N_PER_FRAME]), words) for i in part])
        described[part] = vlad @ projection
    described -= described[some].mean(axis=0)  # what all frames of a scan share tells none apart
    length = np.linalg.norm(described, axis=1, keepdims=True)
    described /= np.maximum(length, 1e-9)
    described[[len(d) == 0 for d in descriptors]] = 0.0
    return described


def most_similar(
    vectors: Float[np.ndarray, "n d"],
    k: int,
    possible: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[Int[np.ndarray, "p 2"], Float[np.ndarray, " p"]]:
    """Pairs, first < second, of each row with the k most similar rows that are `possible`.

    Args:
        vectors: unit rows.
        k: pairs sought for each row; fewer are found where fewer are possible.
        possible: given indices (m, 1) and (m, c), tells which pairs (m, c) are worth a look.

    Returns:
        The pairs, and their similarity.
    """
    n = len(vectors)
    if n < 2:
        return np.zeros((0, 2), dtype=int), np.zeros(0)
    looked_at = min(max(N_LOOKED_AT, k), n)
    # Blocks of rows bound the memory, n floats a row. Of each row the best are parted off unsorted, and
    # only those are asked for (`possible` costs more than the product) and sorted.
    found, alike = [], []
    for first in range(0, n, BLOCK):
        rows = np.arange(first, min(first + BLOCK, n))
        similarity = vectors[rows] @ vectors.T
        similarity[np.arange(len(rows)), rows] = -np.inf
        best = np.argpartition(similarity, n - looked_at, axis=1)[:, n - looked_at :]
        value = np.take_along_axis(similarity, best, axis=1)
        value[~possible(rows[:, None], best)] = -np.inf
        order = np.argsort(-value, axis=1, kind="stable")[:, :k]
        best, value = (np.take_along_axis(part, order, axis=1) for part in (best, value))
        ok = value > 0
        found.append(np.column_stack([np.broadcast_to(rows[:, None], ok.shape)[ok], best[ok]]))
        alike.append(value[ok])
    # A pair may be found from both ends: kept once, with the similarity where it comes first.
    pairs = np.sort(np.concatenate(found), axis=1)
    pairs, first_of = np.unique(pairs, axis=0, return_index=True)
    return pairs, np.concatenate(alike)[first_of]


def similarity_of(
    vectors: Float[np.ndarray, "n d"], pairs: Int[np.ndarray, "p 2"]
) -> Float32[np.ndarray, " p"]:
    """Scalar products of the rows of each pair."""
    result = np.zeros(len(pairs), dtype=np.float32)
    for first in range(0, len(pairs), 16 * BLOCK):  # all at once takes 4 KB a pair
        i, j = pairs[first : first + 16 * BLOCK].T
        result[first : first + len(i)] = np.einsum("ij,ij->i", vectors[i], vectors[j])
    return result


def _vocabulary(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Words (w, d): k-means from random samples; twelve rounds change frame descriptors hardly any more."""
    # Sums of a word's samples are a product with its row of ones; a word without samples stays.
    words = samples[rng.choice(len(samples), _N_WORDS, replace=False)]
    for _ in range(12):
        one_hot = _nearest_word(samples, words)
        count = one_hot.sum(axis=1, keepdims=True)
        words = np.where(count > 0, one_hot @ samples / np.maximum(count, 1.0), words)
    return words


def _nearest_word(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    """(w, k) float32: one where descriptor k is nearest to word w, else nought."""
    # |x - w|^2 less |x|^2, which is the same for all words.
    nearest = (np.sum(words**2, axis=1) - 2.0 * descriptors @ words.T).argmin(axis=1)
    one_hot = np.zeros((len(words), len(descriptors)), dtype=np.float32)
    one_hot[nearest, np.arange(len(nearest))] = 1.0
    return one_hot


def _prepared(descriptors: np.ndarray) -> np.ndarray:
    """As float32, of length about one: SIFT's are scaled by 512."""
    return descriptors.astype(np.float32) / np.float32(512.0)


def _vlad(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    """Residuals (w * d,) about the words, each word's of length one or 0, signed square roots."""
    # The sum of (x - w) over the descriptors of a word is their sum less their number times w.
    one_hot = _nearest_word(descriptors, words)
    residual = one_hot @ descriptors - one_hot.sum(axis=1, keepdims=True) * words
    length = np.linalg.norm(residual, axis=1, keepdims=True)
    flat = (residual / np.maximum(length, 1e-9)).ravel()
    return np.sign(flat) * np.sqrt(np.abs(flat))
