"""What numba makes of ``registers``: a four is a vector of LLVM, an operation one or a few of its instructions."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.typing.templates import AbstractTemplate, infer_global, make_intrinsic_template, signature
from numba.extending import lower_builtin, register_model

_VECTOR = ir.VectorType(ir.DoubleType(), 4)
_PLACE = ir.IntType(32)
_ALIGNED = 8
"""Bytes: those of one number, for fours begin anywhere."""


class FourType(types.Type):
    """The type of a four."""

    def __init__(self) -> None:
        super().__init__("four")


FOUR = FourType()


@register_model(FourType)
class _Model(models.PrimitiveModel):
    """A four is kept in a register."""

    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, _VECTOR)  # type: ignore[no-untyped-call]


def _four(typing: Any, array: Any, place: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        begin = builder.bitcast(_address(context, builder, sig, args), _VECTOR.as_pointer())
        return builder.load(begin, align=_ALIGNED)

    return FOUR(array, place), generate


def _same(typing: Any, number: Any) -> Any:
    return FOUR(types.float64), lambda context, builder, sig, args: _spread(builder, args[0])


def _each(typing: Any, array: Any, place: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        return _spread(builder, builder.load(_address(context, builder, sig, args)))

    return FOUR(array, place), generate


def _put(typing: Any, array: Any, place: Any, numbers: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        begin = builder.bitcast(_address(context, builder, sig, args), _VECTOR.as_pointer())
        builder.store(args[2], begin, align=_ALIGNED)
        return context.get_dummy_value()

    return types.void(array, place, FOUR), generate


def _total(typing: Any, numbers: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        a, b, c, d = (builder.extract_element(args[0], ir.Constant(_PLACE, k)) for k in range(4))
        return builder.fadd(builder.fadd(a, b), builder.fadd(c, d))

    return types.float64(FOUR), generate


def _fetch(typing: Any, array: Any, place: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
        prefetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")  # type: ignore[no-untyped-call]
        address = builder.bitcast(_address(context, builder, sig, args), byte)
        builder.call(
            prefetch, [address, *(ir.Constant(word, k) for k in (0, 3, 1))]
        )  # to read, to be kept, data
        return context.get_dummy_value()

    return types.void(array, place), generate


def _address(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
    """Where the number of an array at a place stands."""
    array = context.make_array(sig.args[0])(context, builder, args[0])
    return builder.gep(array.data, [context.cast(builder, args[1], sig.args[1], types.intp)])


def _spread(builder: Any, number: Any) -> Any:
    """A number four times."""
    nothing = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(_PLACE, 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_PLACE, 4), [0] * 4))


def _define(operation: Callable[..., Any], instruction: str) -> None:
    """Let fours be added or multiplied, one of the two being a number or both fours."""
    kinds = ((FOUR, FOUR), (types.float64, FOUR), (FOUR, types.float64))

    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(FOUR, *args) if tuple(args) in kinds else None  # type: ignore[no-untyped-call]

    infer_global(operation)(Template)  # type: ignore[no-untyped-call]

    def lower(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        one, other = (
            value if type_ == FOUR else _spread(builder, value)
            for type_, value in zip(sig.args, args, strict=True)
        )
        return getattr(builder, instruction)(one, other)

    for kind in kinds:
        lower_builtin(operation, *kind)(lower)  # type: ignore[no-untyped-call]


for _operation, _instruction in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_operation, _instruction)

_TYPES = {
    define.__name__[1:]: types.Function(
        make_intrinsic_template(  # type: ignore[no-untyped-call]
            define, define, define.__name__, prefer_literal=False, kwargs={}
        )
    )
    for define in (_four, _same, _each, _put, _total, _fetch)
}


def function_type(name: str) -> Any:
    """The type of an operation."""
    return _TYPES[name]
