"""Small symmetric systems, compiled: LAPACK takes longer to call than they take to solve."""

from __future__ import annotations

import math

from tacstrip.arrays import FloatArray
from tacstrip.reconstruct.polygon_compiled import F1, F2, compiled


@compiled(f"boolean({F2},int64)")
def cholesky(a: FloatArray, n: int) -> bool:
    """Factor the leading n rows of a in place, lower triangle; return whether they were positive definite."""
    for i in range(n):
        for j in range(i + 1):
            s = a[i, j]
            for p in range(j):
                s -= a[i, p] * a[j, p]
            if i > j:
                a[i, j] = s / a[j, j]
            elif s > 0.0:
                a[i, i] = math.sqrt(s)
            else:
                return False
    return True


@compiled(f"void({F2},int64,{F1})")
def solve_cholesky(a: FloatArray, n: int, b: FloatArray) -> None:
    """Solve with the factor, in place."""
    for i in range(n):
        s = b[i]
        for p in range(i):
            s -= a[i, p] * b[p]
        b[i] = s / a[i, i]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for p in range(i + 1, n):
            s -= a[p, i] * b[p]
        b[i] = s / a[i, i]
