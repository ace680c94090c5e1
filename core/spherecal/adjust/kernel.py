"""How the adjustment's kernels are compiled."""

from typing import Any

# Released from Python's global lock, so that a window stays responsive, and cached on disk after the first call. Fast
# floating point keeps NaN and infinities, as a wild start must be seen as wild. "numpy": dividing by zero gives
# infinity, as in numpy, and no exception.
KERNEL: dict[str, Any] = {
    "nogil": True, "cache": True, "fastmath": {"contract", "reassoc", "nsz"}, "error_model": "numpy",
}  # fmt: skip
# The same of kernels that make no array, without numba's run time. That counts, by atomic instructions, who holds each
# array of a tuple that is passed: an observation's residuals took 0.12 us, and takes 0.01; derivatives 0.15, and 0.03.
BARE: dict[str, Any] = KERNEL | {"_nrt": False}
# Of kernels that kernels call: always inlined, and not in the cache. Such a kernel has two copies, its own and that in
# its caller, optimised (and so rounded) in different ways. Which one ran depended on what had been compiled in the same
# process and what was read from the cache: 1e-14 of a focal length between the first calibration and the second.
INNER: dict[str, Any] = BARE | {"cache": False, "forceinline": True}
INNER_WITH_ARRAYS: dict[str, Any] = INNER | {"_nrt": True}
