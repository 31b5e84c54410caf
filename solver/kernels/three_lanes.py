"""Three doubles at once: a type for numba of colours, whose channels share a vector register.

A register has room for four; the last lane is not used, and what it holds means nothing.
"""

from llvmlite import ir
from numba.core import types
from numba.core.errors import TypingError
from numba.extending import intrinsic, models, register_model

from .lanes import ARITHMETIC, address, of_two, places_of

LANES, CHANNELS = 4, 3
_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_FLOATS = ir.VectorType(ir.FloatType(), LANES)
_TWO = ir.VectorType(ir.DoubleType(), 2)
_INDEX = ir.IntType(32)


class Three(types.Type):
    """The type of three doubles."""

    of, vector = types.float64, _DOUBLES


three = Three("three")


@register_model(Three)
class _ThreeModel(models.PrimitiveModel):
    def __init__(self, manager, of):
        super().__init__(manager, of, _DOUBLES)


for _operation, _instruction in ARITHMETIC:
    of_two(_operation, three, three, _instruction)


def _check(array: types.Array, of: types.Type, axes: int) -> None:
    if array.dtype != of or array.layout != "C" or array.ndim != axes:
        raise TypingError(f"a contiguous array of {of} with {axes} axes is wanted, not {array}")


def _start(context, builder, array, value, *places: tuple[ir.Value, types.Type]) -> ir.Value:
    """Address of array[places…, 0…]; indices are not wrapped around."""
    index = types.UniTuple(types.int64, array.ndim)
    whole = [context.cast(builder, place, of, types.int64) for place, of in places]
    whole += [ir.IntType(64)(0)] * (array.ndim - len(places))
    return address(context, builder, array, value, index, context.make_tuple(builder, index, whole))


@intrinsic
def read(_, array, i, j):
    """array[i, j] of a contiguous array [..., ..., 3] of doubles."""
    _check(array, types.float64, 3)

    def generate(context, builder, signature, values):
        first = _start(context, builder, array, values[0], (values[1], i), (values[2], j))
        two = builder.load(builder.bitcast(first, _TWO.as_pointer()), align=8)
        last = builder.load(builder.gep(first, [_INDEX(2)]))
        wide = builder.shuffle_vector(two, ir.Constant(_TWO, ir.Undefined), places_of(0, 1, 0, 0))
        return builder.insert_element(wide, last, _INDEX(2))

    return three(array, i, j), generate


@intrinsic
def write_row(_, array, n, value):
    """array[n] = value, of a contiguous array [..., 3] of floats."""
    _check(array, types.float32, 2)

    def generate(context, builder, signature, values):
        row = builder.fptrunc(values[2], _FLOATS)
        first = _start(context, builder, array, values[0], (values[1], n))
        for channel in range(CHANNELS):
            place = builder.gep(first, [_INDEX(channel)])
            builder.store(builder.extract_element(row, _INDEX(channel)), place)
        return context.get_dummy_value()

    return types.void(array, n, value), generate


@intrinsic
def write_columns(_, array, n, a, b, c, d):
    """array[n, :, 0] = a, array[n, :, 1] = b and so on, of a contiguous array [..., 3, 4] of floats."""
    _check(array, types.float32, 3)

    def generate(context, builder, signature, values):
        a, b, c, d = (builder.fptrunc(value, _FLOATS) for value in values[2:])
        first = _start(context, builder, array, values[0], (values[1], n))
        for channel in range(CHANNELS):
            ab = builder.shuffle_vector(a, b, places_of(channel, LANES + channel))
            cd = builder.shuffle_vector(c, d, places_of(channel, LANES + channel))
            row = builder.shuffle_vector(ab, cd, places_of(0, 1, 2, 3))
            place = builder.gep(first, [_INDEX(LANES * channel)])
            builder.store(row, builder.bitcast(place, _FLOATS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, n, a, b, c, d), generate
