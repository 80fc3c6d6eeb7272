"""Memory for large results: a block that nothing refers to any more is taken for the next result.

Problem: memory that is new to the process is cleared page by page when first written to, as long as a batch takes.
Solution: blocks that are given back are kept, up to `_KEPT` bytes; new ones of a page or more begin on a large page.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

_PAGE = 2**21  # bytes of a large page
_ALIGNED = 64  # bytes at a multiple of which every array begins
# Bytes that an allocator has at hand; more it takes from the system, and gives back, every time.
_SMALL = 2**17
_KEPT = 128 * 2**20  # bytes that are kept for later at most
_WASTE = 2  # times what is wanted, that a block may have

Block = npt.NDArray[np.uint8]
_free: dict[int, Block] = {}  # by id


class _Lease:
    """What arrays on a block refer to; with the last of them the block is free again."""

    def __init__(self, block: Block) -> None:
        self.block = block
        self.__array_interface__ = block.__array_interface__

    def __del__(self, free: dict[int, Block] = _free) -> None:
        if self.block.nbytes > _KEPT:
            return
        # The longest unused make room: else one large batch would leave none for all smaller ones after it.
        for other in list(free):
            if sum(block.nbytes for block in list(free.values())) + self.block.nbytes <= _KEPT:
                break
            free.pop(other, None)
        free[id(self.block)] = self.block


def empty_arrays(
    wanted: Mapping[str, tuple[tuple[int, ...], npt.DTypeLike]],
) -> dict[str, npt.NDArray[Any]]:
    """Return arrays of these shapes and types by name, not initialised; large ones share a block."""
    sizes = {name: math.prod(shape) * np.dtype(kind).itemsize for name, (shape, kind) in wanted.items()}
    total = sum(size + -size % _ALIGNED for size in sizes.values())
    if total < _SMALL:
        return {name: np.empty(shape, kind) for name, (shape, kind) in wanted.items()}
    block, found, begin = np.asarray(_Lease(_block(total))), {}, 0
    for name, (shape, kind) in wanted.items():
        found[name] = block[begin : begin + sizes[name]].view(kind).reshape(shape)
        begin += sizes[name] + -sizes[name] % _ALIGNED
    return found


def _block(size: int) -> Block:
    """Return a block of so many bytes or more."""
    for block in list(_free.values()):
        # Another thread may have taken it meanwhile.
        if size <= block.nbytes <= _WASTE * size and _free.pop(id(block), None) is not None:
            return block
    aligned = _PAGE if size >= _PAGE else _ALIGNED
    whole: Block = np.empty(size + aligned, np.uint8)
    begin = -whole.ctypes.data % aligned
    return whole[begin : begin + size]
