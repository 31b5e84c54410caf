"""Tensors in nested tuples and lists, such as tables and batches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch


def tensors_of(nested: Any) -> list[torch.Tensor]:
    """All tensors of nested tuples and lists, in order; what is neither is left out."""
    if isinstance(nested, torch.Tensor):
        return [nested]
    if isinstance(nested, tuple | list):
        return [tensor for part in nested for tensor in tensors_of(part)]
    return []


def mapped(change: Callable[[torch.Tensor], torch.Tensor], nested: Any) -> Any:
    """Nested tuples and lists with every tensor changed."""
    if isinstance(nested, torch.Tensor):
        return change(nested)
    if not isinstance(nested, tuple | list):
        return nested
    parts = [mapped(change, part) for part in nested]
    return type(nested)(*parts) if hasattr(nested, "_fields") else type(nested)(parts)
