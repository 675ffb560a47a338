"""Threads: independent calls on all cores, and BLAS kept from starting more of its own.

Compiled loops, OpenCV and NumPy's larger calls let go of the interpreter's lock.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from threadpoolctl import threadpool_limits

Result = TypeVar("Result")


def in_threads(compute: Callable[..., Result], *each: Iterable) -> list[Result]:
    """`compute` of the items of one or several lists, as `map`: a thread a core, results in order.

    What the parts are must not depend on the number of cores, or results would.
    """
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        return list(pool.map(compute, *each))


@contextmanager
def blas_on_one_thread() -> Iterator[None]:
    """BLAS starts no threads of its own inside.

    On small matrices they cost more than they give: descriptors of 300 frames took 1.3 s of CPU time on
    two threads, 0.3 s on one. And beside a pool of workers they fight over cores.
    """
    with threadpool_limits(1, user_api="blas"):
        yield
