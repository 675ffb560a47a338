"""Frames that show the same have similar descriptors; a full search finds the same ones."""

import numpy as np
from numpy.testing import assert_array_equal

from planfit.matching.retrieval import describe_frames, most_similar


def frames(rng, n_places=12, visits=3, n_descriptors=120, noise=12):
    """Descriptors of visits to places, each with its own; a third of every frame is clutter."""
    places = rng.integers(0, 160, (n_places, n_descriptors, 128))
    result = []
    for _ in range(visits):
        for place in places:
            seen = np.clip(place + rng.normal(0, noise, place.shape), 0, 255)
            seen[: n_descriptors // 3] = rng.integers(0, 160, (n_descriptors // 3, 128))
            result.append(rng.permutation(seen.astype(np.uint8)))
    return result


def always(a, b):
    return a != b


def test_visits_of_one_place_are_most_alike(rng):
    described = describe_frames(frames(rng), rng)
    similarity = described @ described.T
    np.fill_diagonal(similarity, -1)
    assert np.mean(similarity.argmax(axis=1) % 12 == np.arange(36) % 12) > 0.9


def test_frame_descriptors_have_length_one_and_empty_frames_none(rng):
    descriptors = frames(rng)
    descriptors[5] = np.zeros((0, 128), np.uint8)
    length = np.linalg.norm(describe_frames(descriptors, rng), axis=1)
    assert length[5] == 0
    assert np.allclose(np.delete(length, 5), 1, atol=1e-5)


def test_too_few_descriptors_for_a_vocabulary_tell_nothing(rng):
    few = [rng.integers(0, 255, (3, 128)).astype(np.uint8) for _ in range(4)]
    assert not describe_frames(few, rng).any()
    assert describe_frames([], rng).shape[0] == 0
    assert not describe_frames([np.zeros((0, 128), np.uint8)] * 3, rng).any()


def test_the_same_generator_gives_the_same(rng):
    descriptors = frames(rng)
    one, two = (describe_frames(descriptors, np.random.default_rng(4)) for _ in range(2))
    assert_array_equal(one, two)


def test_other_kinds_of_descriptors(rng):
    for dims in (32, 256):
        floats = [rng.normal(size=(50, dims)).astype(np.float32) for _ in range(6)]
        assert describe_frames(floats, rng).shape[0] == 6


def test_most_similar_against_a_full_search(rng):
    rows = rng.normal(size=(600, 16)).astype(np.float32)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    pairs, similarity = most_similar(rows, 3, always)
    full = rows @ rows.T
    np.fill_diagonal(full, -np.inf)
    expected = {tuple(sorted((i, int(j)))) for i in range(600) for j in np.argsort(-full[i])[:3]}
    assert set(map(tuple, pairs.tolist())) == expected
    assert np.allclose(similarity, full[pairs[:, 0], pairs[:, 1]], atol=1e-5)


def test_only_possible_pairs(rng):
    rows = rng.normal(size=(60, 16)).astype(np.float32)
    pairs, _ = most_similar(rows, 5, lambda a, b: np.abs(a - b) > 40)
    assert len(pairs) > 0
    assert np.all(pairs[:, 1] - pairs[:, 0] > 40)


def test_fewer_rows_than_asked_for(rng):
    rows = rng.normal(size=(1, 8)).astype(np.float32)
    assert most_similar(rows, 4, always)[0].shape == (0, 2)
    rows = np.ones((3, 8), np.float32)
    assert_array_equal(most_similar(rows, 9, always)[0], [[0, 1], [0, 2], [1, 2]])
