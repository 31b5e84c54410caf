"""Several rays at once: types for numba whose numbers do what a ray's geometry asks of them.

`lanes` moves and adds up what lies in arrays; here are quotients, roots and comparisons, too. All is in
single precision, to which numbers of the source are rounded. A branch is `where`: both ways are taken, and
each ray keeps its own. Functions that branch in no other way work on numbers and on `rays` alike.
"""

import math
import operator
from collections.abc import Callable

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

from .lanes import ARITHMETIC, LANES, Lanes, as_kind, of_two, places_of, spread

CROWD = 32

rays = Lanes("rays", LANES)
"""the type of a number of each of eight rays: as many as fill a register"""
crowd = Lanes("crowd", CROWD)
"""… of as many as it takes to have something to do while others wait for memory"""


class Flags(types.Type):
    """A type of what is true of some rays."""

    def __init__(self, count: int):
        self.count = count
        super().__init__(f"flags of {count}")


@register_model(Flags)
class _FlagsModel(models.PrimitiveModel):
    def __init__(self, manager, of):
        super().__init__(manager, of, ir.VectorType(ir.IntType(1), of.count))


def _of_one(operation, kind: Lanes, generate: Callable) -> None:
    @infer_global(operation)
    class _Typing(AbstractTemplate):
        def generic(self, of, _):
            return signature(kind, kind) if of == (kind,) else None

    lower_builtin(operation, kind)(lambda _, builder, signature, values: generate(builder, *values))


def _comparison(sign: str) -> Callable:
    return lambda builder, a, b: builder.fcmp_ordered(sign, a, b)


def _chosen(sign: str) -> Callable:
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(sign, a, b), a, b)


def _called(name: str) -> Callable:
    """LLVM's function of that name."""

    def generate(builder, value):
        of = value.type
        full = f"llvm.{name}.v{of.count}f32" if isinstance(of, ir.VectorType) else f"llvm.{name}.f64"
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(of, [of]), full)
        return builder.call(function, [value])

    return generate


for _kind in (rays, crowd):
    _flags = Flags(_kind.count)
    for _operation, _generate in (
        *ARITHMETIC, (operator.truediv, ir.IRBuilder.fdiv), (min, _chosen("<")), (max, _chosen(">")),
    ):  # fmt: skip
        of_two(_operation, _kind, _kind, _generate)
    for _operation, _sign in (
        (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
    ):  # fmt: skip
        of_two(_operation, _kind, _flags, _comparison(_sign))
    of_two(operator.and_, _flags, _flags, ir.IRBuilder.and_, lambda of: False)
    for _operation, _generate in (
        (operator.neg, ir.IRBuilder.fneg), (abs, _called("fabs")), (math.sqrt, _called("sqrt")),
    ):  # fmt: skip
        _of_one(_operation, _kind, _generate)


@intrinsic
def any_of(_, test):
    """Whether something is true of any ray."""

    def generate(context, builder, signature, values):
        bits = ir.IntType(test.count)
        return builder.icmp_unsigned("!=", builder.bitcast(values[0], bits), bits(0))

    return types.boolean(test), generate


@intrinsic
def floor(_, value):
    """The next lower whole number, of rays or of a number, in their own type."""
    kind = value if isinstance(value, Lanes) else types.float64

    def generate(context, builder, signature, values):
        number = values[0] if kind is value else context.cast(builder, values[0], value, kind)
        return _called("floor")(builder, number)

    return kind(value), generate


@intrinsic
def rays_of(_, number):
    """The same number for all `rays`."""

    def generate(context, builder, signature, values):
        return as_kind(rays, context, builder, values[0], number)

    return rays(number), generate


@intrinsic
def crowd_of(_, number):
    """The same number for all of a `crowd`."""

    def generate(context, builder, signature, values):
        return as_kind(crowd, context, builder, values[0], number)

    return crowd(number), generate


def _kind_of_choice(test, a, b) -> types.Type:
    for kind in (rays, crowd):
        if kind in (a, b) or (isinstance(test, Flags) and test.count == kind.count):
            return kind
    return types.float32 if a == b == types.float32 else types.float64


@intrinsic
def where(_, test, a, b):
    """a where the test holds, b where it does not: of rays, or of numbers."""
    kind = _kind_of_choice(test, a, b)

    def generate(context, builder, signature, values):
        test, *both = values
        if isinstance(kind, Lanes):
            both = [as_kind(kind, context, builder, *pair) for pair in zip(both, (a, b), strict=True)]
        else:
            both = [context.cast(builder, *pair, kind) for pair in zip(both, (a, b), strict=True)]
        return builder.select(test, *both)

    return kind(test, a, b), generate


def _bytes(builder: ir.IRBuilder, data: ir.Value, places: ir.Value, first: int) -> ir.Value:
    """Eight bytes at the places of lanes from `first` on, as numbers: short chains go on side by side."""
    index = ir.IntType(32)
    read = ir.Constant(ir.VectorType(ir.IntType(8), LANES), ir.Undefined)
    for lane in range(LANES):
        place = builder.sext(builder.extract_element(places, index(first + lane)), ir.IntType(64))
        code = builder.load(builder.gep(data, [place]))
        read = builder.insert_element(read, code, index(lane))
    return builder.uitofp(read, rays.vector)


@intrinsic
def codes_at(_, codes, x, y, z):
    """codes[⌊x⌋, ⌊y⌋, ⌊z⌋] as numbers, of a contiguous array [K, K, K] of bytes, in which all lie."""
    if codes.dtype != types.uint8 or codes.layout != "C" or codes.ndim != 3:
        raise TypingError(f"a contiguous array [K, K, K] of bytes is wanted, not {codes}")
    kind, index = x, ir.IntType(32)

    def generate(context, builder, signature, values):
        found = context.make_array(codes)(context, builder, values[0])
        edge = builder.trunc(builder.extract_value(found.shape, 0), index)
        whole = ir.VectorType(index, kind.count)
        edges = spread(builder, edge, whole)
        i, j, k = (builder.fptosi(value, whole) for value in values[1:])
        places = builder.add(builder.mul(builder.add(builder.mul(i, edges), j), edges), k)
        read = [_bytes(builder, found.data, places, first) for first in range(0, kind.count, LANES)]
        while len(read) > 1:
            joined = places_of(*range(2 * read[0].type.count))
            read = [builder.shuffle_vector(*pair, joined) for pair in zip(*[iter(read)] * 2, strict=True)]
        return read[0]

    return kind(codes, x, y, z), generate
