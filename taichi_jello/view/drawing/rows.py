"""NumPy arrays as kernels see them, and their rows as vectors."""

import taichi as ti

Array1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
Array2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
Index2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
Index1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def row(a: ti.template(), i):
    return vec3(a[i, 0], a[i, 1], a[i, 2])


@ti.func
def face_normal(x: ti.template(), index: ti.template(), t):
    """The normal of triangle t, as long as twice its area."""
    a = row(x, index[t, 0])
    return (row(x, index[t, 1]) - a).cross(row(x, index[t, 2]) - a)


@ti.func
def put(rows: ti.template(), i, v):
    """Set row i of three numbers."""
    for axis in ti.static(range(3)):
        rows[i, axis] = v[axis]


@ti.func
def sum_over(rows: ti.template(), which: ti.template(), first, last):
    """The sum of the rows which[first] … which[last - 1]."""
    total = vec3(0.0)
    for k in range(first, last):
        total += row(rows, which[k])
    return total
