"""Real numbers of fifty digits: sine, cosine, arc sine and 4x4 matrices of them.

The code needs only the standard library. A certified number must be right beyond the digits of any program in
double precision, on every machine alike. Matrices are numpy arrays of `decimal.Decimal`; their products and sums
are exact to the precision of the context.
"""

from __future__ import annotations

import decimal
from collections.abc import Callable, Sequence
from decimal import Decimal
from functools import cache, lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

PRECISION = 50
_NEGLIGIBLE = Decimal(10) ** -(PRECISION + 2)

Matrix = NDArray[Any]  # of Decimal
P = ParamSpec("P")
T = TypeVar("T")


def precise(function: Callable[P, T]) -> Callable[P, T]:
    """Run a function in the arithmetic of fifty digits."""

    @wraps(function)
    def inside(*args: P.args, **kwargs: P.kwargs) -> T:
        with decimal.localcontext(decimal.Context(prec=PRECISION)):
            return function(*args, **kwargs)

    return inside


@cache
@precise
def pi() -> Decimal:
    """Machin: 16 atan(1/5) - 4 atan(1/239)."""

    def atan_of_one_over(n: int) -> Decimal:
        power, total, k = Decimal(1) / n, Decimal(0), 1
        while abs(power) > _NEGLIGIBLE:
            total += power / k
            power, k = -power / (n * n), k + 2
        return total

    return 16 * atan_of_one_over(5) - 4 * atan_of_one_over(239)


def degrees(angle: Decimal) -> Decimal:
    """An angle in degrees, in rad."""
    return angle * pi() / 180


@lru_cache(maxsize=200_000)
@precise
def sine_cosine(angle: Decimal) -> tuple[Decimal, Decimal]:
    """Both Taylor series, at the angle less full turns."""
    angle = angle.remainder_near(2 * pi())
    sums, term, k = [Decimal(0), Decimal(0)], Decimal(1), 0
    while abs(term) > _NEGLIGIBLE:
        sums[k % 2] += -term if k % 4 > 1 else term
        k += 1
        term = term * angle / k
    return sums[1], sums[0]


def arc_sine_ratio(s: Decimal) -> Decimal:
    """asin(s) / s by its series, 1 + s^2/6 + 3 s^4/40 + ..., for |s| below 1."""
    total, term, k = Decimal(0), Decimal(1), 0
    while abs(term) > _NEGLIGIBLE:
        total += term / (2 * k + 1)
        term = term * s * s * (2 * k + 1) / (2 * k + 2)
        k += 1
    return total


def zeros(*shape: int) -> Matrix:
    """An array of Decimal zeros."""
    out = np.empty(shape, dtype=object)
    out.fill(Decimal(0))
    return out


def identity(n: int) -> Matrix:
    """Return the identity matrix, (n, n)."""
    out = zeros(n, n)
    for i in range(n):
        out[i, i] = Decimal(1)
    return out


def diagonal(values: Sequence[Decimal]) -> Matrix:
    """Return a matrix (n, n) with `values` on the diagonal."""
    out = zeros(len(values), len(values))
    for i, value in enumerate(values):
        out[i, i] = value
    return out


def turn(axis: int, angle: Decimal) -> Matrix:
    """Rotation about axis 0, 1 or 2 by an angle in rad, (4, 4)."""
    s, c = sine_cosine(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = identity(4)
    out[i, i], out[j, j], out[i, j], out[j, i] = c, c, -s, s
    return out


def shift(axis: int, length: Decimal) -> Matrix:
    """Translation along axis 0, 1 or 2, (4, 4)."""
    out = identity(4)
    out[axis, 3] = length
    return out


def norm(v: Matrix) -> Decimal:
    """Length of a vector."""
    square: Any = v @ v
    return square.sqrt()


def cross(u: Matrix, v: Matrix) -> Matrix:
    """Cross product of two vectors (3,)."""
    return np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


def rotation_vector(rotation: Matrix) -> Matrix:
    """Compute the log (3,) of a rotation (3, 3), rad.

    Raises
    ------
    ValueError
        The rotation is by a right angle or more.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation
    if a + e + i <= 1:
        raise ValueError("a rotation by a right angle or more")
    sine: Matrix = np.array([h - f, c - g, d - b]) / 2
    return sine * arc_sine_ratio(norm(sine))


def rotation_of_quaternion(q: Matrix) -> Matrix:
    """Compute the rotation (3, 3) of a quaternion (4,), scalar first, of any length."""
    w, x, y, z = q / norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def cholesky(matrix: Matrix) -> Matrix:
    """Lower-triangular L with L L' = matrix, symmetric and positive."""
    n = len(matrix)
    lower = zeros(n, n)
    for j in range(n):
        lower[j, j] = (matrix[j, j] - lower[j, :j] @ lower[j, :j] if j else matrix[j, j]).sqrt()
        for i in range(j + 1, n):
            lower[i, j] = (matrix[i, j] - (lower[i, :j] @ lower[j, :j] if j else 0)) / lower[j, j]
    return lower


def solve_lower(lower: Matrix, right: Matrix) -> Matrix:
    """Solve lower x = right for x; right has shape (n,) or (n, k)."""
    out = right.copy()
    for i in range(len(lower)):
        if i:
            out[i] = out[i] - lower[i, :i] @ out[:i]
        out[i] = out[i] / lower[i, i]
    return out


def factor(matrix: Matrix) -> tuple[Matrix, Matrix]:
    """Q and R of a tall matrix by modified Gram-Schmidt, column by column."""
    q, n = matrix.copy(), matrix.shape[1]
    r = zeros(n, n)
    for j in range(n):
        r[j, j] = norm(q[:, j])
        q[:, j] = q[:, j] / r[j, j]
        for k in range(j + 1, n):
            r[j, k] = q[:, j] @ q[:, k]
            q[:, k] = q[:, k] - q[:, j] * r[j, k]
    return q, r
