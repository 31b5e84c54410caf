"""Hashed uniform numbers: equal twins, uniform, independent of order and batch."""

import numpy as np
import pytest
import scipy.stats
import torch

from solver.kernels.backend import forced_path
from solver.kernels.hashing import uniform, uniform_torch
from tests.kernels.paths import PATHS

KEYS = torch.arange(40_000) * 4096


@pytest.mark.parametrize("path, device", PATHS)
def test_all_twins_give_the_same_bits(path, device):
    keys = torch.cat([KEYS, torch.tensor([0, 1, 2**31, 2**32 - 1, 2**32, 2**58 + 12345])])
    for seed in (0, 1, 2**31, 2**40 + 7):
        with forced_path(path):
            found = uniform(keys.to(device), seed, 3)
        assert torch.equal(found.cpu(), uniform_torch(keys, seed, 3))


def test_numbers_are_uniform_in_the_unit_square():
    values = uniform(KEYS, 5, 2).numpy()
    assert values.min() >= 0 and values.max() < 1
    counts, *_ = np.histogram2d(values[:, 0], values[:, 1], bins=16, range=[[0, 1]] * 2)
    assert scipy.stats.chisquare(counts.ravel()).pvalue > 1e-3


def test_neighbouring_keys_and_seeds_are_uncorrelated():
    a, b, c = uniform(KEYS, 0, 1), uniform(KEYS + 1, 0, 1), uniform(KEYS, 1, 1)
    for other in (b, c):
        assert abs(np.corrcoef(a[:, 0], other[:, 0])[0, 1]) < 0.02


def test_a_key_has_its_number_in_any_batch_and_order():
    order = torch.randperm(len(KEYS), generator=torch.Generator().manual_seed(0))
    assert torch.equal(uniform(KEYS, 3, 2)[order], uniform(KEYS[order], 3, 2))
    assert torch.equal(uniform(KEYS, 3, 2)[17:18], uniform(KEYS[17:18], 3, 2))
