"""The matrix world from body for compiled functions."""

from __future__ import annotations

import numba

from aquanav_tools import types

_rows = numba.njit(cache=True, error_model="numpy")(types.rotation_rows)


@numba.njit(cache=True, error_model="numpy")
def rotation_rows(state):  # type: ignore[no-untyped-def]
    """Return the three rows of the matrix world from body of a (13,) state, as tuples."""
    return _rows(state[3], state[4], state[5], state[6])
