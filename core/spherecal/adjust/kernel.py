"""How the adjustment's kernels are compiled."""

# Released from Python's global lock, so that a window stays responsive, and cached on disk after the first call. Fast
# floating point keeps NaN and infinities, as a wild start must be seen as wild. "numpy": dividing by zero gives
# infinity, as in `engine_numpy`, and no exception.
KERNEL = {"nogil": True, "cache": True, "fastmath": {"contract", "reassoc", "nsz"}, "error_model": "numpy"}
# Of kernels that kernels call. Not inlined, there are two copies of one: its own and that in its caller, optimised (and
# rounded) otherwise. The process that compiles takes the one, those that load the cache the other: the first
# calibration on a machine differed from all later ones in the last digits (1e-10 mm).
INNER = {**KERNEL, "forceinline": True}
