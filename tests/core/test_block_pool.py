"""Memory that large results are written to."""

from __future__ import annotations

import gc

import numpy as np

import tacstrip as ts
from tacstrip.core import block_pool
from tacstrip.core.block_pool import empty_arrays

SHAPES = {"a": ((1_000_000,), np.float32), "b": ((3, 5), np.int8), "c": ((70_000, 2), np.float64)}


def test_a_block_is_taken_again_once_nothing_refers_to_it_and_never_before() -> None:
    first = empty_arrays(SHAPES)
    for name, (shape, kind) in SHAPES.items():
        assert first[name].shape == shape
        assert first[name].dtype == np.dtype(kind)
    places = {name: a.ctypes.data for name, a in first.items()}
    assert not any(place % 64 for place in places.values())
    for number, array in enumerate(first.values()):
        array[:] = number
    part = first["c"][10:20, 1]  # a view of a view holds the block
    del first, array
    gc.collect()
    second = empty_arrays(SHAPES)
    assert not np.shares_memory(part, second["c"])
    for array in second.values():
        array[:] = 9
    assert part.tolist() == [2.0] * 10
    del part, array
    gc.collect()
    third = empty_arrays(SHAPES)
    assert {name: a.ctypes.data for name, a in third.items()} == places


def test_blocks_that_are_kept_have_a_limit_and_are_not_far_too_large() -> None:
    size = block_pool._KEPT // 3
    held = [empty_arrays({"a": ((size,), np.uint8)}) for _ in range(5)]
    del held
    gc.collect()
    assert sum(block.nbytes for block in block_pool._free.values()) <= block_pool._KEPT
    small = empty_arrays({"a": ((2**20,), np.uint8)})["a"]
    assert all(block.nbytes <= block_pool._KEPT for block in block_pool._free.values())
    assert not any(np.shares_memory(small, block) for block in block_pool._free.values())


def test_a_large_block_long_unused_makes_room_for_smaller_ones() -> None:
    large = empty_arrays({"a": ((block_pool._KEPT - 2**22,), np.uint8)})
    del large
    gc.collect()
    place = empty_arrays(SHAPES)["a"].ctypes.data  # given back at once
    gc.collect()
    between = np.empty(2**23, np.uint8)  # takes the memory, if it went back to the system
    assert empty_arrays(SHAPES)["a"].ctypes.data == place
    del between


def test_results_of_a_batch_outlive_the_next_ones() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    shapes = ts.Shapes(n=3000)
    first = ts.simulate_many(sensor, shapes, rng=1)
    kept, copy = first["kh"], first["kh"].copy()
    del first
    for seed in (2, 3, 4):
        ts.simulate_many(sensor, shapes, rng=seed)
    np.testing.assert_array_equal(kept, copy)
