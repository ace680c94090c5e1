"""How the adjustment's kernels are compiled."""

from typing import Any

# Released from Python's global lock, so that a window stays responsive, and cached on disk after the first call. Fast
# floating point keeps NaN and infinities, as a wild start must be seen as wild. "numpy": dividing by zero gives
# infinity, as in numpy, and no exception.
KERNEL: dict[str, Any] = {
    "nogil": True, "cache": True, "fastmath": {"contract", "reassoc", "nsz"}, "error_model": "numpy",
}  # fmt: skip
# Of kernels that kernels call: always inlined, and not in the cache. Such a kernel has two copies, its own and that in
# its caller, optimised (and so rounded) in different ways. Which one ran depended on what had been compiled in the same
# process and what was read from the cache: 1e-14 of a focal length between the first calibration and the second.
INNER: dict[str, Any] = KERNEL | {"cache": False, "forceinline": True}
