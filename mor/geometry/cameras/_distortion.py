"""The radial and decentring polynomials that MOR and both Brown models share.

With r² = x² + y² and an optional second zero crossing r0 of the radial part:

    dx = x [K1 (r² − r0²) + K2 (r⁴ − r0⁴) + K3 (r⁶ − r0⁶)] + P1 (r² + 2 x²) + 2 P2 x y
    dy = y [K1 (r² − r0²) + K2 (r⁴ − r0⁴) + K3 (r⁶ − r0⁶)] + P2 (r² + 2 y²) + 2 P1 x y

Source: Brown 1971; the zero crossing r0 after Wester-Ebbinghaus 1981.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray


class Distortion(NamedTuple):
    """dx, dy and their derivatives by x and y; every field is (n,).

    (dx, dy) is the gradient of a potential, hence ∂dx/∂y = ∂dy/∂x: one field ``xy`` holds both.
    """

    dx: FloatArray
    dy: FloatArray
    xx: FloatArray
    xy: FloatArray
    yy: FloatArray


def distort(
    x: FloatArray,
    y: FloatArray,
    coefficients: FloatArray,
    r0: FloatArray | float,
    by_coefficients: FloatArray,
) -> Distortion:
    """Distortion at (x, y), each (n,), with ``coefficients`` (n, 5) = K1, K2, K3, P1, P2.

    The derivatives by the five coefficients are written into ``by_coefficients`` (n, 2, 5), usually a slice
    of a larger array. ``r0`` is (n,), or 0.0 for the plain polynomial.
    """
    k1, k2, k3, p1, p2 = coefficients.T
    xx, yy, twice_xy = x * x, y * y, 2.0 * x * y
    power2 = xx + yy
    power4 = power2 * power2
    # dq/d(r²) first: it needs the powers before the zero crossing is taken off them
    slope = k1 + 2.0 * k2 * power2 + 3.0 * k3 * power4
    zero2 = np.square(r0)
    radial = (power2 - zero2, power4 - zero2**2, power4 * power2 - zero2**3)
    q = k1 * radial[0] + k2 * radial[1] + k3 * radial[2]
    decentring_x, decentring_y = power2 + 2.0 * xx, power2 + 2.0 * yy

    for column, power in enumerate(radial):
        np.multiply(x, power, out=by_coefficients[:, 0, column])
        np.multiply(y, power, out=by_coefficients[:, 1, column])
    by_coefficients[:, 0, 3] = decentring_x
    by_coefficients[:, 1, 3] = by_coefficients[:, 0, 4] = twice_xy
    by_coefficients[:, 1, 4] = decentring_y

    p1_x, p2_y = 2.0 * p1 * x, 2.0 * p2 * y
    return Distortion(
        dx=x * q + p1 * decentring_x + p2 * twice_xy,
        dy=y * q + p2 * decentring_y + p1 * twice_xy,
        xx=q + 2.0 * xx * slope + 3.0 * p1_x + p2_y,
        xy=twice_xy * slope + 2.0 * (p1 * y + p2 * x),
        yy=q + 2.0 * yy * slope + 3.0 * p2_y + p1_x,
    )
