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
