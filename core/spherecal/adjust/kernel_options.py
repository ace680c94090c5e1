"""How numba compiles the kernels of the adjustment.

Sums may be taken in the order that is fastest ("reassoc"), which the compiler chooses when a function meets its caller.
A part with a compiled form of its own in numba's cache is taken from there, or merged with its caller where both are
compiled in one process: other rounding by what was compiled before (1e-14 of f between a first run and the second).
So a part has no entry in the cache, and is always merged.
"""

from typing import Any

# without "nnan" and "ninf": a wild start must be seen as wild
_FAST = {"contract", "reassoc", "nsz"}
# "numpy": dividing by zero gives infinity, as in the other engine, and no exception
KERNEL: dict[str, Any] = {"nogil": True, "cache": True, "fastmath": _FAST, "error_model": "numpy"}
# What only kernels call.
KERNEL_PART: dict[str, Any] = KERNEL | {"cache": False, "forceinline": True}
