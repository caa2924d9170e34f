"""Samples of a field in blocks of one cache line: whoever reads a field between its samples waits for memory once.

A brick of 8 x 8 x 8 cells is 64 blocks of 2 x 2 x 2 cells, 4096 bytes, a page. A block has its 27 samples as 16-bit
shares of its own range, one spare number, and as float32 the middle of that range and the size of a share. A distance
changes by less than 3.5 spacings within a block, so that a share is below 6e-5 spacings, and half of it is the error.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.errors import ResourceError
from aquanav_tools.geometry.volume.field import BRICK
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

BLOCK = 2
"""Cells along a block's edge."""
NUM_BLOCKS = (BRICK // BLOCK) ** 3
"""In a brick."""
LINE = 32
"""Numbers of 16 bits in a block."""
PAGE = 4096
"""Bytes."""
SHARES = 32767
"""A block's range is twice as many shares."""
MAX_BRICKS = 2**31 // (NUM_BLOCKS * LINE) - 1
"""Numbers are counted in 32 bits."""


def pack(samples: npt.NDArray[np.float32], spacing: float, device: Any) -> Any:
    """Return samples on a device, in blocks and in spacings.

    Args:
        samples: (B, 9, 9, 9) in each brick, m.
        spacing: Between samples, m.
        device: Warp's.

    Raises:
        ResourceError: there are too many bricks to be counted.
    """
    num = len(samples)
    if num > MAX_BRICKS:
        raise ResourceError(
            f"The distance field has {num} bricks of 8 x 8 x 8 samples; a batch can count {MAX_BRICKS}. "
            "Build the cave with a larger spacing."
        )
    room = np.empty(num * PAGE + PAGE, dtype=np.uint8)
    first = -room.ctypes.data % PAGE
    packed = room[first : first + num * PAGE].reshape(num, NUM_BLOCKS, -1)
    _fill(samples, spacing, packed.view(np.int16), packed.view(np.float32))
    return wp.array(packed.view(np.int16).ravel(), dtype=wp.int16, device=device, copy=not device.is_cpu)


@numba.njit(cache=True)
def _fill(samples, spacing, shares, ranges):  # type: ignore[no-untyped-def]
    """Write (B, 64, 32) shares and, in the same memory, (B, 64, 16) middles and sizes of a share."""
    edge = BRICK // BLOCK
    for brick in range(len(samples)):
        for block in range(NUM_BLOCKS):
            x, y, z = BLOCK * (block // edge**2), BLOCK * (block // edge % edge), BLOCK * (block % edge)
            own = samples[brick, x : x + 3, y : y + 3, z : z + 3]
            low, high = own.min() / spacing, own.max() / spacing
            middle, size = np.float32(0.5 * (low + high)), np.float32((high - low) / (2 * SHARES))
            for n in range(27):
                share = 0.0
                if size > 0.0:
                    share = (own[n // 9, n // 3 % 3, n % 3] / spacing - middle) / size
                shares[brick, block, n] = np.int16(min(max(np.rint(share), -SHARES), SHARES))
            shares[brick, block, 27] = 0
            ranges[brick, block, 14], ranges[brick, block, 15] = middle, size


@wp.func_native("""
    int brick = bricks.data[((i >> 3) * num_y + (j >> 3)) * num_z + (k >> 3)];
    int block = 64 * brick + 8 * (i & 6) + 2 * (j & 6) + ((k & 6) >> 1);
#if defined(__clang__) && !defined(__CUDACC__) && !defined(__CUDA_ARCH__)
    __builtin_prefetch(samples.data + 32 * (size_t)block);
#endif
    return 32 * block + 9 * (i & 1) + 3 * (j & 1) + (k & 1);
""")
def cell_of(
    bricks: wp.array(dtype=wp.int32), samples: wp.array(dtype=wp.int16), num_y: int, num_z: int, i: int, j: int, k: int
) -> int:  # type: ignore[empty-body]
    """Return the number of a cell's first sample; the processor begins to fetch the cell's block."""


@wp.func_native("""
    const short* p = samples.data + (size_t)cell;
    const float* range = (const float*)(samples.data + ((size_t)cell | 31) - 3);
#if defined(__clang__) && !defined(__CUDACC__) && !defined(__CUDA_ARCH__)
    typedef short short8 __attribute__((ext_vector_type(8)));
    typedef float float8 __attribute__((ext_vector_type(8)));
    typedef float float4_ __attribute__((ext_vector_type(4)));
    typedef float float2_ __attribute__((ext_vector_type(2)));
    short8 low, high;
    __builtin_memcpy(&low, p, 16);
    __builtin_memcpy(&high, p + 9, 16);
    float8 corners = __builtin_convertvector(__builtin_shufflevector(low, high, 0, 1, 3, 4, 8, 9, 11, 12), float8);
    float4_ face = corners.lo + x * (corners.hi - corners.lo);
    float2_ edge = face.lo + y * (face.hi - face.lo);
    float share = edge.x + z * (edge.y - edge.x);
#else
    float a = p[0] + x * (p[9] - p[0]), b = p[1] + x * (p[10] - p[1]);
    float c = p[3] + x * (p[12] - p[3]), d = p[4] + x * (p[13] - p[4]);
    a += y * (c - a);
    b += y * (d - b);
    float share = a + z * (b - a);
#endif
    return range[0] + range[1] * share;
""")
def interpolated(samples: wp.array(dtype=wp.int16), cell: int, x: float, y: float, z: float) -> float:  # type: ignore[empty-body]
    """Return the value in a cell at shares x, y and z of its edges, as one vector where the processor has them."""


@wp.func_native("""
    const float* range = (const float*)(samples.data + ((size_t)cell | 31) - 3);
    return range[0] + range[1] * samples.data[(size_t)cell + 9 * i + 3 * j + k];
""")
def corner(samples: wp.array(dtype=wp.int16), cell: int, i: int, j: int, k: int) -> float:  # type: ignore[empty-body]
    """Return the sample at a cell's corner; i, j and k are 0 or 1."""
