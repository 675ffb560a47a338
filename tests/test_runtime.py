"""Work over many items: order, cache, damage, interruption, progress, a full disk."""

import errno
import gc
import io
import itertools
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from threadpoolctl import threadpool_info

from planfit.errors import OutputError
from planfit.runtime import Runtime, StageTimer, blas_on_one_thread, cache_key, in_threads
from planfit.runtime.cache_chunks import DamagedChunk, read_chunk, write_chunk


class Counter:
    """Computes squares, and remembers which."""

    def __init__(self):
        self.asked = []
        self._lock = threading.Lock()

    def __call__(self, i):
        with self._lock:
            self.asked.append(i)
        return {"square": np.array([i * i]), "name": np.array(f"item {i}")}


def squares(items):
    return [int(item["square"][0]) for item in items]


@pytest.mark.parametrize("workers", [1, 2, 7])
@pytest.mark.parametrize("chunk_size", [1, 4, 100])
def test_results_are_in_order_whatever_the_threads_do(workers, chunk_size):
    def slow_first(i):
        time.sleep(0.002 if i < 5 else 0)
        return {"square": np.array([i * i])}

    items = Runtime(workers).map("squares", "key", 23, slow_first, chunk_size)
    assert squares(items) == [i * i for i in range(23)]


def test_threads_are_used():
    barrier = threading.Barrier(2, timeout=60)

    def meet(i):
        barrier.wait()
        return {"i": np.array(i)}

    Runtime(2).map("meet", "key", 2, meet, chunk_size=1)


def blas_threads():
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def test_blas_threads_are_one_inside_and_as_before_afterwards():
    before, inside = blas_threads(), []
    both, first_done = threading.Barrier(2, timeout=60), threading.Event()

    def overlap(i):
        both.wait()
        if i == 1:  # ends well after the other, which began with it
            first_done.wait(0.1)
        inside.append(blas_threads())
        return {"i": np.array(i)}

    Runtime(2).map("overlap", "key", 2, overlap, chunk_size=1)
    assert all(n == 1 for threads in inside for n in threads)
    assert blas_threads() == before


def test_blas_has_its_threads_back_after_an_error():
    before, inside = blas_threads(), []

    def fail():
        with blas_on_one_thread():
            inside.extend(blas_threads())
            raise RuntimeError("inside")

    with pytest.raises(RuntimeError, match="inside"):
        fail()
    assert set(inside) <= {1}
    assert blas_threads() == before


def test_nothing_to_do():
    assert Runtime().map("none", "key", 0, Counter()) == []


def test_without_a_folder_nothing_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    count = Counter()
    for _ in range(2):
        Runtime().map("squares", "key", 3, count)
    assert len(count.asked) == 6
    assert list(tmp_path.iterdir()) == []


def test_a_second_run_takes_everything_from_the_cache(tmp_path):
    runtime = Runtime(2, tmp_path / "cache")
    first = runtime.map("squares", "key", 10, Counter(), 4)
    count = Counter()
    second = runtime.map("squares", "key", 10, count, 4)
    assert count.asked == []
    assert squares(second) == squares(first)
    for one, two in zip(first, second, strict=True):
        assert one.keys() == two.keys()
        assert all(one[name].dtype == two[name].dtype for name in one)


def test_arrays_come_back_as_they_were(tmp_path):
    arrays = {
        "empty": np.zeros((0, 3), np.float32),
        "bytes": np.arange(5, dtype=np.uint8),
        "nan": np.array([[np.nan, np.inf]]),
        "n_items": np.array(7),
        "a/b": np.array([1.0]),
        "none": np.array(True),
        "words": np.array(["one", "three"]),
        "columns first": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "every other": np.arange(8)[::2],
    }
    runtime = Runtime(1, tmp_path)
    runtime.map("kept", "key", 1, lambda _: arrays)
    back = runtime.map("kept", "key", 1, Counter())[0]
    assert back.keys() == arrays.keys()
    for name, value in arrays.items():
        assert_array_equal(back[name], value)
        assert back[name].dtype == value.dtype
        assert back[name].flags.writeable
        assert back[name].base is None  # what one array holds on to is not the whole chunk


def test_objects_are_not_kept(tmp_path):
    with pytest.raises(TypeError, match="thing: expected an array of plain values, found object"):
        Runtime(1, tmp_path).map("kept", "key", 1, lambda _: {"thing": np.array([None])})


@pytest.mark.parametrize("other", [("squares", "another"), ("cubes", "key")])
def test_another_key_or_stage_is_computed(tmp_path, other):
    runtime = Runtime(1, tmp_path)
    runtime.map("squares", "key", 3, Counter())
    count = Counter()
    runtime.map(*other, 3, count)
    assert sorted(count.asked) == [0, 1, 2]


def test_keys_change_with_any_part():
    keys = {
        cache_key("b"),
        cache_key("a"),
        cache_key("a", 1),
        cache_key("a", 1.0),
        cache_key("a", np.array([1.0])),
        cache_key("a", np.array([1.0]).tobytes()),
    }
    assert len(keys) == 6
    assert cache_key("a", 1) == cache_key("a", 1)


def test_what_has_no_fingerprint_is_not_kept(tmp_path):
    assert cache_key("", "keypoints") == ""
    runtime = Runtime(1, cache_dir=tmp_path)
    for value in (1.0, 2.0):  # another scan in memory, the same stage and options
        (item,) = runtime.map("stage", cache_key("", 7), 1, lambda _, v=value: {"v": np.array([v])})
        assert item["v"] == [value]
    assert not list(tmp_path.iterdir())


_archive = io.BytesIO()
np.savez(_archive, n_items=np.array(4), square=np.arange(4))
ARCHIVE = _archive.getvalue()
DAMAGE = {
    "cut in half": lambda data: data[: len(data) // 2],
    "empty": lambda _: b"",
    "no archive": lambda _: b"garbage" * 50,
    "starts like one": lambda _: b"PK\x03\x04garbage",
    "bits flipped": lambda data: data[:100] + bytes(b ^ 0xFF for b in data[100:140]) + data[140:],
    "nothing but zeros": lambda data: bytes(len(data)),
    "a longer one": lambda data: data + b"\0",
    "an archive": lambda _: ARCHIVE,
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_corrupt_chunk_is_made_again_and_the_others_are_not(tmp_path, damage):
    runtime = Runtime(1, tmp_path)
    runtime.map("squares", "key", 12, Counter(), 4)
    chunk = sorted(tmp_path.rglob("*.chunk"))[1]
    chunk.write_bytes(DAMAGE[damage](chunk.read_bytes()))
    count = Counter()
    items = runtime.map("squares", "key", 12, count, 4)
    assert squares(items) == [i * i for i in range(12)]
    assert sorted(count.asked) == [4, 5, 6, 7]
    again = Counter()
    runtime.map("squares", "key", 12, again, 4)
    assert again.asked == []


def test_a_chunk_in_the_place_of_another_is_made_again(tmp_path, caplog):
    """Of the same stage, of another, and of the same with other inputs: whole, and not believed."""
    runtime = Runtime(1, tmp_path)
    for stage, key in (("squares", "key"), ("squares", "other"), ("cubes", "key")):
        runtime.map(stage, key, 8, Counter(), 4)
    first, second = sorted((tmp_path / "squares-key").iterdir())
    assert not caplog.messages
    for other in (second, *sorted(tmp_path.glob("*-*/000000.chunk"))):
        if other == first:
            continue
        first.write_bytes(other.read_bytes())
        count = Counter()
        assert squares(runtime.map("squares", "key", 8, count, 4)) == [i * i for i in range(8)]
        assert count.asked == [0, 1, 2, 3]
        assert "found 1 of 2 damaged or exchanged; these are redone" in caplog.messages[-1]
    assert len(caplog.messages) == 3


def test_no_flipped_bit_is_believed(tmp_path, rng):
    items = [
        {"pose": np.eye(4), "idx": np.arange(3)},
        {},
        {"empty": np.zeros((0, 2)), "pose": np.ones((4, 4))},
    ]
    path = tmp_path / "000000.chunk"
    write_chunk(path, items)
    whole = path.read_bytes()
    for _ in range(10_000):
        data = bytearray(whole)
        for at in rng.choice(len(data), rng.integers(1, 4), replace=False):
            data[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        with pytest.raises(DamagedChunk):
            read_chunk(path, 3)
    path.write_bytes(whole)
    again = read_chunk(path, 3)
    assert again is not None
    for before, after in zip(items, again, strict=True):
        assert list(before) == list(after.arrays)
        for name, array in before.items():
            assert array.dtype == after.arrays[name].dtype
            np.testing.assert_array_equal(array, after.arrays[name])
    with pytest.raises(DamagedChunk):
        read_chunk(path, 2)
    assert read_chunk(tmp_path / "absent.chunk", 3) is None


def test_a_chunk_that_holds_a_bare_array_is_made_again(tmp_path):
    runtime = Runtime(1, tmp_path)
    runtime.map("squares", "key", 3, Counter())
    chunk = next(tmp_path.rglob("*.chunk"))
    with chunk.open("wb") as file:
        np.save(file, np.zeros(3))
    count = Counter()
    runtime.map("squares", "key", 3, count)
    assert len(count.asked) == 3


def test_a_chunk_of_another_length_is_made_again(tmp_path):
    # The same key with other chunks: the first file holds 4 items where 8 are asked for.
    runtime = Runtime(1, tmp_path)
    runtime.map("squares", "key", 8, Counter(), 4)
    items = runtime.map("squares", "key", 8, Counter(), 8)
    assert squares(items) == [i * i for i in range(8)]


def test_an_error_inside_comes_out_as_it_is(tmp_path):
    def fails(i):
        if i == 5:
            raise KeyError("item five")
        return {"square": np.array([i])}

    with pytest.raises(KeyError, match="item five"):
        Runtime(2, tmp_path).map("squares", "key", 10, fails, 2)


def test_an_interrupted_run_goes_on_where_it_was(tmp_path):
    def stops(i):
        if i == 6:
            raise KeyboardInterrupt
        return {"square": np.array([i * i])}

    with pytest.raises(KeyboardInterrupt):
        Runtime(1, tmp_path).map("squares", "key", 10, stops, 2)
    count = Counter()
    items = Runtime(1, tmp_path).map("squares", "key", 10, count, 2)
    assert squares(items) == [i * i for i in range(10)]
    assert sorted(count.asked)[:2] == [6, 7]  # 8 and 9 may have ended before the stop was seen


def test_a_chunk_that_ends_while_another_fails_is_kept(tmp_path):
    both = threading.Barrier(2, timeout=60)

    def one_fails(i):
        both.wait()
        if i == 0:
            raise ValueError("first")
        time.sleep(0.05)
        return {"square": np.array([i * i])}

    with pytest.raises(ValueError, match="first"):
        Runtime(2, tmp_path).map("squares", "key", 2, one_fails, 1)
    count = Counter()
    Runtime(1, tmp_path).map("squares", "key", 2, count, 1)
    assert count.asked == [0]


def test_after_an_error_chunks_not_begun_are_dropped():
    count = Counter()

    def fails(i):
        count(i)
        time.sleep(0.02)  # else a busy machine may end all of them before it looks at the first
        raise ValueError("all do")

    with pytest.raises(ValueError, match="all do"):
        Runtime(1).map("squares", "key", 200, fails, 1)
    assert len(count.asked) < 100


def test_progress_rises_to_the_total(tmp_path):
    told = []

    def listen(stage, done, total):
        told.append((stage, done, total))

    runtime = Runtime(2, tmp_path, listen)
    runtime.map("squares", "key", 10, Counter(), 3)
    assert {(stage, total) for stage, _, total in told} == {("squares", 10)}
    done = [d for _, d, _ in told]
    assert done[0] == 0
    assert done[-1] == 10
    assert all(b - a in (1, 3) for a, b in itertools.pairwise(done))
    told.clear()
    runtime.map("squares", "key", 10, Counter(), 3)
    assert told == [("squares", 10, 10)]


def full_disk(*args, **options):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("step", ["open", "replace"])
def test_a_full_disk_is_an_output_error_and_leaves_no_partial_file(tmp_path, monkeypatch, step):
    monkeypatch.setattr(Path, step, full_disk)
    with pytest.raises(OutputError, match=r"squares-key.*No space left.*free disk space"):
        Runtime(2, tmp_path).map("squares", "key", 3, Counter())
    monkeypatch.undo()
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_disk_that_fills_while_writing(tmp_path, monkeypatch):
    opened = Path.open

    def open_full(path, *how, **named):
        return opened(Path("/dev/full") if path.suffix == ".part" else path, *how, **named)

    monkeypatch.setattr(Path, "open", open_full)
    with pytest.raises(OutputError, match="No space left"):
        Runtime(1, tmp_path).map("squares", "key", 3, Counter())
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


def test_a_cache_that_cannot_be_made(tmp_path):
    (tmp_path / "cache").write_text("a file is in the way")
    with pytest.raises(OutputError, match="cannot be made"):
        Runtime(1, tmp_path / "cache").map("squares", "key", 3, Counter())


def test_stages_are_timed_and_told_of():
    told = []
    timer = StageTimer(Runtime(1, on_progress=lambda *what: told.append(what)))
    with timer.stage("rest"):
        time.sleep(0.02)
    with pytest.raises(ValueError, match="no"), timer.stage("fail"):
        raise ValueError("no")
    assert list(timer.seconds) == ["rest"]
    assert 0.02 <= timer.seconds["rest"] < 5
    assert told == [("rest", 0, 0), ("rest", 1, 0), ("fail", 0, 0)]


def test_seconds_of_stages_add_up_to_all():
    begin = time.perf_counter()
    timer = StageTimer(Runtime(1), begin - 1)
    with timer.stage("outer"):
        time.sleep(0.02)
        with timer.stage("inner"):
            time.sleep(0.03)
        with timer.stage("inner"):
            time.sleep(0.03)
    time.sleep(0.02)
    seconds = timer.all_seconds()
    took_s = 1 + time.perf_counter() - begin
    assert list(seconds) == ["read", "inner", "outer", "other"]
    assert seconds["read"] == pytest.approx(1, abs=0.01)
    assert seconds["inner"] >= 0.06
    assert 0.02 <= seconds["outer"] < took_s - 1 - 0.06
    assert seconds["other"] >= 0.02
    assert sum(seconds.values()) == pytest.approx(took_s, abs=0.01)


def halves(i):
    return {"small": np.array([i]), "large": np.arange(4.0).reshape(2, 2) + i}


@pytest.mark.parametrize("has_cache", [True, False])
def test_large_arrays_stay_on_disk_until_they_are_asked_for(tmp_path, has_cache):
    runtime = Runtime(2, tmp_path if has_cache else None)
    items = runtime.map_stored("halves", "key", 5, halves, ("large",), chunk_size=2)
    assert [item.arrays.keys() for item in items] == [{"small"}] * 5
    for i, item in enumerate(items):
        assert item.arrays["small"] == i
        assert len(item.stored["large"]) == 2
        assert_array_equal(item.stored["large"].read(), halves(i)["large"])
        assert_array_equal(item.stored["large"][1:], halves(i)["large"][1:])


def test_stored_arrays_are_found_again_and_are_those_of_a_map(tmp_path):
    first, second, other = Counter(), Counter(), Counter()
    runtime = Runtime(2, tmp_path)
    runtime.map("squares", "key", 5, first, chunk_size=2)
    items = runtime.map_stored("squares", "key", 5, second, ("square",), chunk_size=2)
    assert [int(item.stored["square"].read()[0]) for item in items] == [0, 1, 4, 9, 16]
    assert squares(runtime.map("squares", "key", 5, other, chunk_size=2)) == [0, 1, 4, 9, 16]
    assert (len(first.asked), second.asked, other.asked) == (5, [], [])


def test_a_temporary_folder_lives_as_long_as_what_is_stored_there():
    items = Runtime(1).map_stored("halves", "", 3, halves, ("large",))
    folder = items[0].stored["large"].path.parent
    last = items[2].stored["large"]
    del items
    gc.collect()
    assert_array_equal(last.read(), halves(2)["large"])
    del last
    gc.collect()
    assert not folder.exists()


@pytest.mark.parametrize("spoil", [Path.unlink, lambda path: path.write_bytes(b"short")])
def test_a_cache_that_is_cleared_under_a_run_is_one_line(tmp_path, spoil):
    stored = Runtime(1, tmp_path).map_stored("halves", "key", 1, halves, ("large",))[0].stored
    spoil(stored["large"].path)
    with pytest.raises(
        OutputError, match=r"expected what this run kept there, found .*; run again"
    ):
        stored["large"].read()


def test_a_damaged_chunk_of_stored_arrays_is_computed_again(tmp_path):
    runtime = Runtime(1, tmp_path)
    path = runtime.map_stored("halves", "key", 1, halves, ("large",))[0].stored["large"].path
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(bytes(data))
    again = runtime.map_stored("halves", "key", 1, halves, ("large",))[0]
    assert_array_equal(again.stored["large"].read(), halves(0)["large"])


@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
def test_memory_that_a_stage_freed_goes_back_to_the_system():
    code = """
import numpy as np
from planfit.runtime import Runtime, StageTimer

def resident_mb():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6

def many_small(_):
    return {str(k): np.ones(4000) for k in range(500)}  # 16 MB

timer, before = StageTimer(Runtime(2)), resident_mb()
with timer.stage("work"):
    items = Runtime(2).map("small", "", 10, many_small, 1)
    held, last = resident_mb(), items[-1]
    del items  # but for the last, which lies among the others
print(held - before, resident_mb() - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    held, after = (float(word) for word in done.stdout.split())
    assert held > 140
    assert after < 60


def test_calls_in_threads_come_in_order_and_fail_as_they_would():
    assert in_threads(lambda a, b: a * b, range(50), range(50)) == [k * k for k in range(50)]
    assert in_threads(str, []) == []
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda k: 1 // k, [2, 1, 0, 3])
