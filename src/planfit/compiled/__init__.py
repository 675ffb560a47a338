"""Kernels: loops that numba compiles, taken ready from the package where it has them for this machine.

`kernel` is the decorator of every compiled function of planfit. Where `ready/` beside this file holds what
was compiled before (by whoever made the wheel, or by `planfit doctor --compile`) from the same sources, for
the same numba and Python, for features that this CPU has, it is loaded in milliseconds; all else is compiled
at its first call, and kept by numba where numba keeps it. See docs/adr/0029-kernels-in-the-wheel.md.
"""

from planfit.compiled.decorator import kernel as kernel
