"""The factorisation B = L D Lᵀ of a symmetric positive definite 3×3 matrix, given by its xx, yy, zz, yz, xz and xy."""

import taichi as ti


@ti.func
def factorise(B, epsilon):
    """The pivots of D, and the yx, zx and zy of L. epsilon: the rounding unit, which bounds the pivots from below."""
    smallest = 4.0 * epsilon
    yx, zx = B[5] / B[0], B[4] / B[0]
    dy = ti.max(B[1] - yx * B[5], smallest * B[1])
    zy = (B[3] - zx * B[5]) / dy
    dz = ti.max(B[2] - zx * B[4] - zy * zy * dy, smallest * B[2])
    return ti.Vector([B[0], dy, dz]), ti.Vector([yx, zx, zy])


@ti.func
def substitute(D, L, r):
    """B⁻¹ r."""
    y = r[1] - L[0] * r[0]
    z = (r[2] - L[1] * r[0] - L[2] * y) / D[2]
    y = y / D[1] - L[2] * z
    return ti.Vector([r[0] / D[0] - L[0] * y - L[1] * z, y, z])


@ti.func
def solve(B, r, epsilon):
    """B⁻¹ r."""
    D, L = factorise(B, epsilon)
    return substitute(D, L, r)
