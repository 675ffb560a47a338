"""How a file is damaged: bits, pieces, numbers, lines, values of JSON, by a generator of random numbers."""

import json
import re
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np

HOSTILE_NUMBERS = (
    b"nan", b"inf", b"-inf", b"0", b"-1", b"1", b"1e308", b"-1e308", b"1e999", b"1e-320", b"4294967295",
    b"2147483648", b"-2147483649", b"18446744073709551616", b"9" * 400, b"1" + b"0" * 20, b"0.1.2", b"1,5",
    b"0x10", b"", b"1e", b"--3", b"\xd9\xa3", b"1_000",
)  # fmt: skip
HOSTILE_VALUES: tuple[Any, ...] = (
    None, True, "", "x", [], {}, [[]], -1, 0, 2**63, 2**70, 1e308, -1e308, float("nan"), float("inf"), 1e-320,
    "9" * 400, "\x1b[31m[red]\n", [None], {"": None}, "../../etc/passwd", "\ud800",
)  # fmt: skip
HOSTILE_WORDS = (
    b"\x00", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x01\x00\x00\x00", b"\r\n",
    b"\x1b[2J", b"../../../../etc/passwd", b"%n%s", b"\xef\xbb\xbf", b"[red]", b"\xed\xa0\x80",
    b"{" * 2000, b"[" * 2000,
    b"(" * 2000, b"<a>" * 2000, b"A" * 5000,
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_HEAD = 400
"""Bytes that say how the rest is to be read, mostly."""

Mutation = Callable[[bytes, np.random.Generator], bytes]


def _at(data: bytes, rng: np.random.Generator) -> int:
    """A place in the file; half of the time in its head or its tail, where directories are."""
    n, where = len(data), rng.random()
    if n == 0:
        return 0
    if where < 0.35:
        return int(rng.integers(min(n, _HEAD)))
    if where < 0.5:
        return int(n - 1 - rng.integers(min(n, _HEAD)))
    return int(rng.integers(n))


def flip_bits(data: bytes, rng: np.random.Generator) -> bytes:
    spoiled = bytearray(data)
    for _ in range(int(rng.choice([1, 2, 8, 40])) if data else 0):
        spoiled[_at(data, rng)] ^= 1 << int(rng.integers(8))
    return bytes(spoiled)


def set_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    spoiled = bytearray(data)
    for _ in range(int(rng.choice([1, 4, 30])) if data else 0):
        spoiled[_at(data, rng)] = int(rng.integers(256))
    return bytes(spoiled)


def set_integer(data: bytes, rng: np.random.Generator) -> bytes:
    """A count, a size or an offset becomes huge, negative or 0."""
    size = int(rng.choice([1, 2, 4, 8]))
    value = int(rng.choice([0, 1, 2 ** (8 * size - 1) - 1, 2 ** (8 * size - 1), 2 ** (8 * size) - 1, 1000])) \
        if size < 8 else [0, 1, 2**63 - 1, 2**63, 2**64 - 1, 2**32][int(rng.integers(6))]  # fmt: skip
    packed = (value % 2 ** (8 * size)).to_bytes(size, "little" if rng.random() < 0.7 else "big")
    at = _at(data, rng)
    return data[:at] + packed + data[at + size :]


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: _at(data, rng)]


def drop_piece(data: bytes, rng: np.random.Generator) -> bytes:
    at = _at(data, rng)
    return data[:at] + data[at + int(rng.choice([1, 4, 64, 1000])) :]


def repeat_piece(data: bytes, rng: np.random.Generator) -> bytes:
    at, size, times = _at(data, rng), int(rng.choice([4, 64, 1000])), int(rng.choice([1, 3, 50]))
    return data[:at] + data[at : at + size] * times + data[at:]


def insert_words(data: bytes, rng: np.random.Generator) -> bytes:
    at = _at(data, rng)
    return data[:at] + HOSTILE_WORDS[int(rng.integers(len(HOSTILE_WORDS)))] + data[at:]


def change_numbers(data: bytes, rng: np.random.Generator) -> bytes:
    found = list(_NUMBER.finditer(data[:200_000]))
    if not found:
        return flip_bits(data, rng)
    spoiled = data
    chosen = rng.choice(len(found), min(len(found), int(rng.choice([1, 1, 3, 20]))), replace=False)
    for i in sorted(
        chosen, reverse=True
    ):  # from the end, so that places before stay where they are
        other = HOSTILE_NUMBERS[int(rng.integers(len(HOSTILE_NUMBERS)))]
        spoiled = spoiled[: found[i].start()] + other + spoiled[found[i].end() :]
    return spoiled


def change_lines(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.split(b"\n")
    i, j = (int(rng.integers(len(lines))) for _ in range(2))
    how = int(rng.integers(5))
    if how == 0:
        del lines[i]
    elif how == 1:
        lines[i], lines[j] = lines[j], lines[i]
    elif how == 2:
        lines.insert(i, lines[j])
    elif how == 3:
        words = lines[i].split(b" ")
        del words[int(rng.integers(len(words)))]
        lines[i] = b" ".join(words)
    else:
        lines[i] = lines[i] * int(rng.choice([2, 100]))
    return b"\n".join(lines)


def change_json(data: bytes, rng: np.random.Generator) -> bytes:
    """Some value of a JSON file becomes another, goes, or is nested a thousand times."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return change_numbers(data, rng)
    for _ in range(int(rng.choice([1, 1, 2, 5]))):
        places = _places(content)
        if not places:
            break
        holder, key = places[int(rng.integers(len(places)))]
        how = rng.random()
        if how < 0.2:
            del holder[key]
        elif how < 0.25:
            for _ in range(1000):
                holder[key] = [holder[key]]
        elif how < 0.35 and isinstance(holder, list):
            holder.insert(key, holder[key])
        else:
            holder[key] = deepcopy(HOSTILE_VALUES[int(rng.integers(len(HOSTILE_VALUES)))])
    try:
        return json.dumps(content).encode("utf-8", "surrogatepass")
    except RecursionError:
        return b"[" * 1500 + data + b"]" * 1500


def _places(content: Any) -> list[tuple[Any, Any]]:
    """Every container and key or index in it, those that were nested a thousand times not within."""
    found, waiting = [], [(content, 0)]
    while waiting and len(found) < 20_000:
        one, depth = waiting.pop()
        keys = (
            list(one) if isinstance(one, dict) else range(len(one)) if isinstance(one, list) else ()
        )
        for key in keys:
            found.append((one, key))
            if depth < 12:
                waiting.append((one[key], depth + 1))
    return found


BINARY: tuple[Mutation, ...] = (
    flip_bits, set_bytes, set_integer, set_integer, cut, drop_piece, repeat_piece, insert_words,
)  # fmt: skip
TEXT: tuple[Mutation, ...] = (
    change_numbers, change_numbers, change_lines, change_lines, cut, drop_piece, repeat_piece, insert_words,
    flip_bits,
)  # fmt: skip


def mutated(files: dict[str, bytes], rng: np.random.Generator) -> dict[str, bytes | None]:
    """Files that become others, by their names; None where a file goes."""
    names = list(files)
    # Text files say how all the rest is to be read, and are few: they are damaged as often as images.
    texts = [name for name in names if _is_text(files[name])]
    chosen = texts if texts and rng.random() < 0.6 else names
    name = chosen[int(rng.integers(len(chosen)))]
    data, how = files[name], rng.random()
    if len(names) > 1 and how < 0.04:
        return {name: None}
    if len(names) > 1 and how < 0.08:
        return {name: files[names[int(rng.integers(len(names)))]]}
    if how < 0.1:
        return {name: b""}
    for _ in range(int(rng.choice([1, 1, 1, 2, 4]))):
        kinds = TEXT if _is_text(data) else BINARY
        if _is_json(data) and rng.random() < 0.6:
            kinds = (change_json,)
        data = kinds[int(rng.integers(len(kinds)))](data, rng)
    return {name: data}


def _is_text(data: bytes) -> bool:
    return b"\0" not in data[:2000]


def _is_json(data: bytes) -> bool:
    return data.lstrip()[:1] in (b"{", b"[")
