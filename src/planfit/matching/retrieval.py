"""Frames that look alike: VLAD over the keypoints' own descriptors.

A frame is described by how its descriptors lie about each word of a small vocabulary learned from the
scan itself (Jegou, Douze, Schmid and Perez 2010), with residuals normalised word by word (Arandjelovic
and Zisserman 2013). Two frames are as alike as the scalar product of theirs.
"""

from collections.abc import Callable

import numpy as np

N_WORDS = 48
N_SAMPLES = 8_000
"""Descriptors that the vocabulary is learned from."""
N_PER_FRAME = 400
"""Descriptors of a frame that count, the first of it; more change its description little."""
DIMENSIONS = 512
"""Descriptions are projected to this many numbers; a random projection keeps scalar products to 4 %."""
BLOCK = 256
N_LOOKED_AT = 64
"""The most similar rows of each, of which the possible ones are taken."""


def describe_frames(descriptors: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Unit descriptions (n, 512) float32 of frames from their descriptors, each (k, d); 0 where k is 0."""
    n = len(descriptors)
    dims = descriptors[0].shape[1] if n else 0
    some = [i for i in range(n) if len(descriptors[i])]
    described = np.zeros((n, DIMENSIONS), dtype=np.float32)
    if not some:
        return described
    each = max(1, N_SAMPLES // len(some))
    sampled = some if len(some) <= N_SAMPLES else rng.choice(some, N_SAMPLES, replace=False)
    samples = np.concatenate(
        [_prepared(descriptors[i][rng.permutation(len(descriptors[i]))[:each]]) for i in sampled]
    )
    if len(samples) < 2 * N_WORDS:
        return described
    words = _vocabulary(samples, rng)
    projection = rng.normal(size=(N_WORDS * dims, DIMENSIONS)).astype(np.float32)
    for first in range(0, len(some), 64):
        part = some[first : first + 64]
        vlad = np.stack([_vlad(_prepared(descriptors[i][:N_PER_FRAME]), words) for i in part])
        described[part] = vlad @ projection
    described -= described[some].mean(axis=0)  # what all frames of a scan share tells none apart
    length = np.linalg.norm(described, axis=1, keepdims=True)
    described /= np.maximum(length, 1e-9)
    described[[len(d) == 0 for d in descriptors]] = 0.0
    return described


def most_similar(
    descriptions: np.ndarray, k: int, possible: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (p, 2), first < second, of each row with the k most similar rows that are `possible`.

    Args:
        descriptions: (n, d) unit rows.
        k: pairs sought for each row; fewer are found where fewer are possible.
        possible: given indices (m, 1) and (m, c), tells which pairs (m, c) are worth a look.

    Returns:
        The pairs, and their similarity (p,).
    """
    n = len(descriptions)
    if n < 2:
        return np.zeros((0, 2), dtype=int), np.zeros(0)
    looked_at = min(max(N_LOOKED_AT, k), n)
    found, alike = [], []
    for first in range(0, n, BLOCK):
        rows = np.arange(first, min(first + BLOCK, n))
        similarity = descriptions[rows] @ descriptions.T
        similarity[np.arange(len(rows)), rows] = -np.inf
        best = np.argpartition(similarity, n - looked_at, axis=1)[:, n - looked_at :]
        value = np.take_along_axis(similarity, best, axis=1)
        value[~possible(rows[:, None], best)] = -np.inf
        order = np.argsort(-value, axis=1, kind="stable")[:, :k]
        best, value = (np.take_along_axis(part, order, axis=1) for part in (best, value))
        ok = value > 0
        found.append(np.column_stack([np.broadcast_to(rows[:, None], ok.shape)[ok], best[ok]]))
        alike.append(value[ok])
    pairs = np.sort(np.concatenate(found), axis=1)
    pairs, first_of = np.unique(pairs, axis=0, return_index=True)
    return pairs, np.concatenate(alike)[first_of]


def similarity_of(descriptions: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Scalar products (p,) of the rows (n, d) of each pair (p, 2)."""
    result = np.zeros(len(pairs), dtype=np.float32)
    for first in range(0, len(pairs), 16 * BLOCK):  # all at once takes 4 KB a pair
        i, j = pairs[first : first + 16 * BLOCK].T
        result[first : first + len(i)] = np.einsum("ij,ij->i", descriptions[i], descriptions[j])
    return result


def _vocabulary(samples: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Words (w, d): k-means from random samples; twelve rounds change descriptions hardly any more."""
    words = samples[rng.choice(len(samples), N_WORDS, replace=False)]
    for _ in range(12):
        one_hot = _nearest_word(samples, words)
        count = one_hot.sum(axis=1, keepdims=True)
        words = np.where(count > 0, one_hot @ samples / np.maximum(count, 1.0), words)
    return words


def _nearest_word(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    """(w, k) float32: one where descriptor k is nearest to word w, else nought."""
    nearest = (np.sum(words**2, axis=1) - 2.0 * descriptors @ words.T).argmin(axis=1)
    one_hot = np.zeros((len(words), len(descriptors)), dtype=np.float32)
    one_hot[nearest, np.arange(len(nearest))] = 1.0
    return one_hot


def _prepared(descriptors: np.ndarray) -> np.ndarray:
    return descriptors.astype(np.float32) / np.float32(512.0)


def _vlad(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    """Residuals (w * d,) about the words, each word's of length one or 0, signed square roots."""
    one_hot = _nearest_word(descriptors, words)
    residual = one_hot @ descriptors - one_hot.sum(axis=1, keepdims=True) * words
    length = np.linalg.norm(residual, axis=1, keepdims=True)
    flat = (residual / np.maximum(length, 1e-9)).ravel()
    return np.sign(flat) * np.sqrt(np.abs(flat))
