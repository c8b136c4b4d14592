"""Draw rows and columns of many tables at once, each entry by its weight; what is left of the numbers drawn is used on."""

from typing import Any

import numpy as np
from jaxtyping import Float


class Table:
    """`k` tables of weights, rows by columns; a draw keeps neighbours of the numbers neighbours in the table."""

    def __init__(self, mi: Any, weights: Float[np.ndarray, "*k h w"]):
        self.mi = mi
        every = weights.reshape(-1, *weights.shape[-2:]).astype(float)
        self.rows, self.columns = every.shape[1:]
        rows = every.sum(2)
        self.row_sums = _running(rows)
        self.column_sums = _running(every)
        total = rows.sum(1, keepdims=True)[..., None]
        self.row_table = mi.Float(np.ravel(self.row_sums).astype(np.float32))
        self.column_table = mi.Float(np.ravel(self.column_sums).astype(np.float32))
        self.chances = mi.Float(np.ravel(every / np.maximum(total, 1e-30)).astype(np.float32))
        del self.row_sums, self.column_sums

    def sample(self, table: Any, u: Any, v: Any, active: Any = True) -> tuple[Any, Any, Any, Any]:
        """Row by `u`, column by `v`; the numbers' remainders as a point in [0, 1)^2, and the entry's chance."""
        mi = self.mi
        row, across = self._find(self.row_table, table * self.rows, self.rows, u, active)
        column, along = self._find(
            self.column_table, (table * self.rows + row) * self.columns, self.columns, v, active
        )
        return row, column, mi.Point2f(across, along), self.chance(table, row, column, active)

    def chance(self, table: Any, row: Any, column: Any, active: Any = True) -> Any:
        import drjit as dr

        return dr.gather(
            self.mi.Float, self.chances, (table * self.rows + row) * self.columns + column, active
        )

    def _find(self, sums: Any, begin: Any, count: int, u: Any, active: Any) -> tuple[Any, Any]:
        """First entry whose running sum exceeds `u`, and how far into it `u` reaches."""
        mi = self.mi
        import drjit as dr

        low = mi.UInt32(0) + dr.zeros(mi.UInt32, dr.width(u))
        step = 1 << max(count - 1, 0).bit_length()
        while step > 1:
            step //= 2
            there = low + step
            below = (there < count) & (
                dr.gather(mi.Float, sums, begin + dr.minimum(there, count) - 1, active) <= u
            )
            low = dr.select(below, there, low)
        upper = dr.gather(mi.Float, sums, begin + low, active)
        lower = dr.select(low > 0, dr.gather(mi.Float, sums, begin + dr.maximum(low, 1) - 1, active), 0.0)
        return low, dr.clip((u - lower) / dr.maximum(upper - lower, 1e-12), 0, 1 - 2.0**-24)


def _running(weights: np.ndarray) -> np.ndarray:
    """Running sums along the last axis, ending at 1; even where there is no weight."""
    total = weights.sum(-1, keepdims=True)
    even = np.where(total > 0, weights / np.where(total > 0, total, 1), 1 / weights.shape[-1])
    sums = np.cumsum(even, -1)
    sums[..., -1] = 1.0
    return sums
