"""Tensors in nested tuples and lists, such as tables and batches."""

from collections.abc import Callable
from typing import Any

from torch import Tensor


def tensors_of(nested: Any) -> list[Tensor]:
    """All tensors of nested tuples and lists, in order; what is neither is left out."""
    if isinstance(nested, Tensor):
        return [nested]
    if isinstance(nested, tuple | list):
        return [tensor for part in nested for tensor in tensors_of(part)]
    return []


def mapped(change: Callable[[Tensor], Tensor], nested: Any) -> Any:
    """Nested tuples and lists with every tensor changed."""
    if isinstance(nested, Tensor):
        return change(nested)
    if not isinstance(nested, tuple | list):
        return nested
    parts = [mapped(change, part) for part in nested]
    return type(nested)(*parts) if hasattr(nested, "_fields") else type(nested)(parts)
