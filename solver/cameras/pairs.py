"""Which photos are compared with which."""

from itertools import combinations

EXHAUSTIVE_UP_TO = 120
"""photos up to which `auto` compares all with all: some minutes on two cores"""
NEIGHBOURS, KEY_PHOTOS = 10, 24


def pairs_of(count: int, matcher: str) -> list[tuple[int, int]]:
    """Pairs (i < j) of photos numbered from 0, those taken one after the other first.

    `sequential` compares each photo with the next `NEIGHBOURS`, with those 16, 32, 64… further on, and
    `KEY_PHOTOS` spread over all of them with each other, so that a walk around the object closes.
    """
    if matcher == "exhaustive" or (matcher == "auto" and count <= EXHAUSTIVE_UP_TO):
        pairs = set(combinations(range(count), 2))
    else:
        steps = [*range(1, NEIGHBOURS + 1)]
        steps += [2**power for power in range(4, 31) if 2**power < count]
        pairs = {(i, i + step) for step in steps for i in range(count - step)}
        every = max(1, -(-count // KEY_PHOTOS))
        keys = sorted({*range(0, count, every), count - 1})
        pairs |= set(combinations(keys, 2))
    return sorted(pairs, key=lambda pair: (pair[1] - pair[0], pair))
