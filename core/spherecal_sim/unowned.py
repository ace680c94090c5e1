"""Arguments of kernels without numba's reference counts, which were half of a render's time on one core."""

from typing import Any

from spherecal.base.kernels import AHEAD, njit


def _itself(arrays: Any) -> Any:
    """Arrays, or a tuple with arrays, without reference counts; valid while the caller keeps them."""
    return arrays


if AHEAD is not None:
    unowned: Any = njit(_itself)  # what was compiled ahead has the intrinsic below inside
else:
    from numba.core import cgutils, types
    from numba.extending import intrinsic

    def _without_counts(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            for name in ("meminfo", "parent"):
                setattr(array, name, cgutils.get_null_value(getattr(array, name).type))
            return array._getvalue()
        if isinstance(kind, types.Tuple | types.NamedTuple):
            parts = [
                _without_counts(context, builder, part, builder.extract_value(value, i))
                for i, part in enumerate(kind.types)
            ]
            return context.make_tuple(builder, kind, parts)
        return value

    def _typed(typing_context: Any, arrays: Any) -> Any:
        """Arrays, or a tuple with arrays, without reference counts; valid while the caller keeps them."""

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return _without_counts(context, builder, signature.args[0], arguments[0])

        return arrays(arrays), codegen

    unowned = intrinsic(_typed)
