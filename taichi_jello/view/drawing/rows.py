"""NumPy arrays as kernels see them, and their rows as vectors."""

import taichi as ti

Array1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
Array2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
Index2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
Index1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
Keys = ti.types.ndarray(dtype=ti.i64, ndim=2)
Depths = ti.types.ndarray(dtype=ti.f32, ndim=2)
Counts = ti.types.ndarray(dtype=ti.i32, ndim=2)
Sums = ti.types.ndarray(dtype=ti.i32, ndim=3)
Colors = ti.types.ndarray(dtype=ti.f32, ndim=3)
Image = ti.types.ndarray(dtype=ti.u32, ndim=2)  # a pixel's red, green, blue and 255, one byte each from the lowest
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def row(a: ti.template(), i):
    return vec3(a[i, 0], a[i, 1], a[i, 2])


@ti.func
def put(rows: ti.template(), i, v):
    """Set the three numbers of row i."""
    for axis in ti.static(range(3)):
        rows[i, axis] = v[axis]


@ti.func
def face_normal(x: ti.template(), index: ti.template(), t):
    """The normal of triangle t, twice its area long."""
    a = row(x, index[t, 0])
    return (row(x, index[t, 1]) - a).cross(row(x, index[t, 2]) - a)
