"""Linear constraints on a contact's ends, and least-squares steps within them.

A step d minimises d C d / 2 - f d under G d >= h. With C = R' R this is the point of a polyhedron that lies nearest
to the origin, which non-negative least squares finds: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems
(1974), chapter 23, problem LDP.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray


def linear_constraints(
    strip: IntArray, length: float, shortest: float, convex: bool
) -> tuple[FloatArray, FloatArray]:
    """Return G (C, 2 T) and h (C,) of G x >= h for the ends x = l, then u, of the touched strips (T,).

    0 <= l, l + shortest <= u, u <= length; and, for convex contacts, l bends up only and u down only over any
    three strips in a row.
    """
    one = np.eye(len(strip))
    none = np.zeros_like(one)
    left = [np.hstack([one, none]), np.hstack([-one, one]), np.hstack([none, -one])]
    right = [np.zeros(len(strip)), np.full(len(strip), shortest), np.full(len(strip), -length)]
    if convex:
        inner = np.flatnonzero((np.diff(strip[:-1]) == 1) & (np.diff(strip[1:]) == 1))
        bend = one[inner] - 2.0 * one[inner + 1] + one[inner + 2] if len(inner) else none[:0]
        left += [np.hstack([bend, none[: len(inner)]]), np.hstack([none[: len(inner)], -bend])]
        right.append(np.zeros(2 * len(inner)))
    return np.concatenate(left), np.concatenate(right)


def constrained_step(
    curvature: FloatArray, descent: FloatArray, constraints: FloatArray, limits: FloatArray
) -> FloatArray:
    """Return the d that minimises d C d / 2 - f d under G d >= h.

    Parameters
    ----------
    curvature, descent
        C (N, N), positive definite, and f (N,).
    constraints, limits
        G (constraints, N) and h (constraints,); at least one d must satisfy them.
    """
    from scipy.linalg import cholesky, solve_triangular
    from scipy.optimize import nnls

    scale = 1.0 / np.sqrt(np.diag(curvature))
    root = cholesky(curvature * np.outer(scale, scale))  # upper
    free = solve_triangular(root, descent * scale, trans="T")
    step = scale * solve_triangular(root, free)
    if np.all(constraints @ step >= limits):
        return np.asarray(step)
    # In z = R d / scale - free: the nearest point to the origin with G z >= h.
    tilted = solve_triangular(root, (constraints * scale).T, trans="T").T
    norm = np.linalg.norm(tilted, axis=1)
    tilted, lack = tilted / norm[:, None], (limits - constraints @ step) / norm
    far = np.abs(lack[lack > 0.0]).max()
    system = np.vstack([tilted.T, lack / far])
    aim = np.zeros(len(system))
    aim[-1] = 1.0
    weight, _ = nnls(system, aim, maxiter=10 * len(lack))
    rest = system @ weight - aim
    z = -rest[:-1] / rest[-1] * far
    return np.asarray(scale * solve_triangular(root, free + z))
