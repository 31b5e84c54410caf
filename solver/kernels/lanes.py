"""Eight channels at once: a type for numba that LLVM keeps in vector registers.

A loop over channels that reads and writes rows of the same arrays stays scalar, since the compiler can't
know that the rows differ; and one with a sum is unrolled further than there are channels. With this
type nothing is left to it (docs/decisions/0005). Where a processor's registers are shorter, LLVM takes two.

What works on `Lanes` works on a single number, too: `load` returns as many as `like` has. What `store` or
`add_to` wrote is read with `load`: numba may move other reads of an array before what it does not
know to be writes.
"""

import operator
from collections.abc import Callable

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

LANES = 8


class Lanes(types.Type):
    """A type of several numbers in single precision; what one can do with them belongs to its name."""

    of = types.float32

    def __init__(self, name: str, count: int):
        self.count, self.vector = count, ir.VectorType(ir.FloatType(), count)
        super().__init__(name)


eight = Lanes("eight", LANES)
_INDEX = ir.IntType(32)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, of):
        super().__init__(manager, of, of.vector)


def places_of(*places: int) -> ir.Constant:
    """Which lanes a shuffle takes."""
    return ir.Constant(ir.VectorType(_INDEX, len(places)), places)


def spread(builder: ir.IRBuilder, number: ir.Value, vector: ir.VectorType) -> ir.Value:
    """The same number in all lanes of a vector."""
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, number, _INDEX(0))
    return builder.shuffle_vector(first, nothing, places_of(*[0] * vector.count))


def as_kind(kind: types.Type, context, builder: ir.IRBuilder, value: ir.Value, of: types.Type) -> ir.Value:
    """A value of a type of lanes; a number is put into all of them, in their precision."""
    if of is kind:
        return value
    return spread(builder, context.cast(builder, value, of, kind.of), kind.vector)


def is_number(of: types.Type) -> bool:
    return isinstance(of, types.Float | types.Integer)


def of_two(
    operation: Callable, kind: types.Type, result: types.Type, generate: Callable,
    beside: Callable[[types.Type], bool] = is_number,
) -> None:  # fmt: skip
    """Define `operation` for two values of a type of lanes, or for one and a number.

    Args:
        kind: with its LLVM `vector`, and `of`, the type of a lane. generate: an instruction of two vectors.
        beside: which types of numbers may stand beside it.
    """

    @infer_global(operation)
    class _Typing(AbstractTemplate):
        def generic(self, of, _):
            known = len(of) == 2 and kind in of and all(a is kind or beside(a) for a in of)
            return signature(result, *of) if known else None

    def lower(context, builder, signature, values):
        pairs = zip(values, signature.args, strict=True)
        return generate(builder, *(as_kind(kind, context, builder, *pair) for pair in pairs))

    for of in ((kind, kind), (kind, types.Number), (types.Number, kind)):
        lower_builtin(operation, *of)(lower)


ARITHMETIC = (
    (operator.add, ir.IRBuilder.fadd), (operator.sub, ir.IRBuilder.fsub),
    (operator.mul, ir.IRBuilder.fmul),
)  # fmt: skip
for _operation, _instruction in ARITHMETIC:
    # A double beside them is a mistake: kernels of lookups are meant to have none.
    of_two(_operation, eight, eight, _instruction, lambda of: of is types.float32)


@intrinsic
def eight_of(_, number):
    """Eight times the same number (float32)."""

    def generate(_, builder, signature, values):
        return spread(builder, values[0], eight.vector)

    return eight(types.float32), generate


@intrinsic
def total(_, value):
    """The sum of eight numbers, pair by pair; a single one as it is."""
    if value not in (eight, types.float32):
        raise TypingError(f"lanes are of float32, not of {value}")

    def generate(_, builder, signature, values):
        (summed,) = values
        count = LANES if value is eight else 1
        while count > 1:
            count //= 2
            halves = places_of(*range(count)), places_of(*range(count, 2 * count))
            nothing = ir.Constant(summed.type, ir.Undefined)
            summed = builder.fadd(*(builder.shuffle_vector(summed, nothing, h) for h in halves))
        return builder.extract_element(summed, _INDEX(0)) if value is eight else summed

    return types.float32(value), generate


def address(context, builder, array, value, index, places) -> ir.Value:
    """Of array[index]; indices are not wrapped around."""
    unpacked = cgutils.unpack_tuple(builder, places, len(index))
    whole = [
        context.cast(builder, place, kind, types.intp) for place, kind in zip(unpacked, index, strict=True)
    ]
    found = context.make_array(array)(context, builder, value)
    return cgutils.get_item_pointer(context, builder, array, found, whole, wraparound=False)


def _pointer(context, builder, array, value, index, places, of) -> ir.Value:
    """To array[index], or to the numbers from there on."""
    pointer = address(context, builder, array, value, index, places)
    return builder.bitcast(pointer, of.vector.as_pointer()) if isinstance(of, Lanes) else pointer


def _check(array: types.Array, index: types.BaseTuple) -> None:
    if array.dtype != types.float32 or array.layout != "C" or len(index) != array.ndim:
        raise TypingError(f"lanes are of contiguous float32 arrays by all indices, not of {array}")


@intrinsic
def load(_, array, index, like):
    """Numbers of an array from `index` on, which has one for each axis, along the last axis."""
    _check(array, index)
    of = like if isinstance(like, Lanes) else types.float32

    def generate(context, builder, signature, values):
        pointer = _pointer(context, builder, array, values[0], index, values[1], of)
        return builder.load(pointer, align=4)

    return of(array, index, like), generate


def _storing(added: bool):
    def typed(_, array, index, value):
        _check(array, index)
        of = value if isinstance(value, Lanes) else types.float32

        def generate(context, builder, signature, values):
            pointer = _pointer(context, builder, array, values[0], index, values[1], of)
            there = values[2]
            if added:
                there = builder.fadd(builder.load(pointer, align=4), there)
            builder.store(there, pointer, align=4)
            return context.get_dummy_value()

        return types.void(array, index, of), generate

    return typed


store = intrinsic(_storing(added=False))
"""array[index…] = value"""
add_to = intrinsic(_storing(added=True))
"""array[index…] += value"""


@intrinsic
def fetch(_, array, index):
    """Ask for the line of array[index…], one index for each axis, which will be read soon."""

    def generate(context, builder, signature, values):
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, _INDEX, _INDEX, _INDEX])
        prefetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        place = address(context, builder, array, values[0], index, values[1])
        to_read, often, data = _INDEX(0), _INDEX(3), _INDEX(1)
        builder.call(prefetch, [builder.bitcast(place, byte), to_read, often, data])
        return context.get_dummy_value()

    return types.void(array, index), generate
