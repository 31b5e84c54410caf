"""Items of rows one after the other, such as the samples of rays, and how long an array of them is.

Mostly as long as what there is, which a card has to be waited for. A CUDA graph, though, launches the same
kernels on the same memory again and again: under `reserved` lengths, arrays have room for more, and what
fills the rest counts for nothing:

- it lies at the end, and there is at least one of it, the last item;
- each belongs to the last row, which is itself such an item, or to any where rows are all real;
- it has no weight, though it is as real ones are else, so that neither what is seen nor a gradient has
  anything of it.

What does not fit is left out, of the last rows first; the totals that `reserved` yields tell of it.
"""

import contextlib
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor


class UnlikeObserved(RuntimeError):
    """There are not as many flat forms as lengths reserved for them."""


_state: dict[str, object] = {"lengths": None, "totals": None}


def offsets_of(counts: Tensor) -> tuple[Tensor, int]:
    """Where each of N rows with `counts` [N] of items begins in flat form and the last one ends, [N + 1];
    and the length of the flat form."""
    offsets = torch.nn.functional.pad(counts.cumsum(0), (1, 0))
    length = _length_for(offsets[-1:])
    return (offsets.clamp(max=length - 1) if is_reserved() else offsets), length


def indices_of(chosen: Tensor) -> tuple[Tensor, Tensor | None]:
    """Where `chosen` [N] is true, ascending, and, under reserved lengths, which of these [K] are there for
    that; what fills the rest names the last item."""
    if not is_reserved():
        indices = chosen.nonzero()[:, 0]
        if _state["totals"] is not None:
            _state["totals"].append(len(indices))
        return indices, None
    ends = chosen.cumsum(0)
    length, last = _length_for(ends[-1:]), len(chosen) - 1
    # All that is not chosen, or has no room, is put in one place, which is then filled.
    place = torch.where(chosen, ends - 1, length - 1).clamp(max=length - 1)
    indices = ends.new_full((length,), last)
    indices.scatter_(0, place, torch.arange(len(chosen), device=chosen.device))
    indices[-1:].fill_(last)
    return indices, torch.arange(length, device=chosen.device) < ends[-1:].clamp(max=length - 1)


def room_for(like: Tensor, *shape: int, fill: float = 0) -> Tensor:
    """An array whose items are yet to be written; under reserved lengths what is not written is `fill`."""
    return like.new_full(shape, fill) if is_reserved() else like.new_empty(shape)


def filled_up(offsets: Tensor, *arrays: Tensor) -> tuple[Tensor, ...]:
    """Arrays of items [K, ...] in flat form; under reserved lengths what fills them is as the first item,
    so that nothing is computed of it that could not be of any other."""
    if not is_reserved():
        return arrays
    real = torch.arange(len(arrays[0]), device=offsets.device) < offsets[-1:]
    return tuple(torch.where(real.view(-1, *[1] * (array.dim() - 1)), array, array[:1]) for array in arrays)


def is_reserved() -> bool:
    """True where lengths are reserved."""
    return _state["lengths"] is not None


def nothing_follows(items: Tensor) -> bool:
    """True if there are no items, so that what would be done with them can be left out; not where there
    have to be the same flat forms each time."""
    return len(items) == 0 and has_no_order()


def has_no_order() -> bool:
    """True where flat forms may be more or fewer the next time."""
    return _state["totals"] is None


def _length_for(total: Tensor) -> int:
    """Length of an array for `total` [1] items."""
    lengths, totals = _state["lengths"], _state["totals"]
    if lengths is not None:
        totals.append(total)
        if len(totals) > len(lengths):
            raise UnlikeObserved
        return lengths[len(totals) - 1]
    length = int(total)
    if totals is not None:
        totals.append(length)
    return length


@contextlib.contextmanager
def observed() -> Iterator[list[int]]:
    """Within this block the lengths of all flat forms are noted, in order; for one thread only."""
    totals: list[int] = []
    with _in_state(None, totals):
        yield totals


@contextlib.contextmanager
def reserved(lengths: Sequence[int]) -> Iterator[list[Tensor]]:
    """Within this block flat forms have these lengths, in order; yields what they are to hold, [1] each.

    A length has to be greater than what there is. Nothing waits for the device. For one thread only, and
    for kernels in Warp.

    Raises:
        UnlikeObserved: there are not as many flat forms.
    """
    totals: list[Tensor] = []
    with _in_state(lengths, totals):
        yield totals
    if len(totals) != len(lengths):
        raise UnlikeObserved


@contextlib.contextmanager
def _in_state(lengths: Sequence[int] | None, totals: list) -> Iterator[None]:
    before = dict(_state)
    _state.update(lengths=lengths, totals=totals)
    try:
        yield
    finally:
        _state.update(before)
