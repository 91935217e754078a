"""A single cell or triangle: whether a cell holds a point, and which place of a triangle is nearest to one."""

import taichi as ti

from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import FAR

ROOT_FAR = FAR**0.5  # m
PARALLEL = 1e-6  # the square of the sine between segments up to which they are so, by their ends alone
AROUND = (4, 6, 2, 3, 1, 5)  # the corners of a cell around its diagonal from corner 0 to corner 7


@ti.func
def nearest(p, a, b, c):
    """The weights of the corners a, b, c in the point of their triangle that is nearest to p; of a segment if b = c
    (Ericson, Real-Time Collision Detection, 5.1.5)."""
    ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
    d1, d2, d3, d4, d5, d6 = ab.dot(ap), ac.dot(ap), ab.dot(bp), ac.dot(bp), ab.dot(cp), ac.dot(cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    w1, w2 = ti.cast(0.0, float), ti.cast(0.0, float)
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        w1 = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        w1 = d1 / (d1 - d3)
    elif d6 >= 0.0 and d5 <= d6:
        w2 = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w2 = d2 / (d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w2 = (d4 - d3) / (d4 - d3 + d5 - d6)
        w1 = 1.0 - w2
    else:
        w1, w2 = vb / (va + vb + vc), vc / (va + vb + vc)
    return ti.Vector([1.0 - w1 - w2, w1, w2])


@ti.func
def nearer(place: ti.template(), p, triangle, best, corners, weights):
    """The nearest place so far: its distance from p, its triangle's corners and their weights."""
    a, b, c = place[triangle[0]], place[triangle[1]], place[triangle[2]]
    n, most = (b - a).cross(c - a), ti.min(best, ROOT_FAR)
    above = n.dot(p - a)
    if above * above <= most * most * n.norm_sqr():  # else its plane is farther away
        w = nearest(p, a, b, c)
        distance = (w[0] * a + w[1] * b + w[2] * c - p).norm()
        if distance < best:
            best, corners, weights = distance, triangle, w
    return best, corners, weights


@ti.func
def closest(p, along, most, a, edge):
    """Where the segments p + u along, 0 <= u <= most, and a + s edge, 0 <= s <= 1, are nearest to each other: u and s
    (Ericson, Real-Time Collision Detection, 5.1.9)."""
    way, dd, ee, de = p - a, along.norm_sqr(), ti.max(edge.norm_sqr(), 1e-30), along.dot(edge)
    down, up = along.dot(way), edge.dot(way)
    size, u = dd * ee - de * de, ti.cast(0.0, float)
    if size > PARALLEL * dd * ee:
        u = ti.math.clamp((de * up - down * ee) / size, 0.0, most)
    s = (de * u + up) / ee
    if s < 0.0 or s > 1.0:
        s = ti.math.clamp(s, 0.0, 1.0)
        u = ti.math.clamp((de * s - down) / ti.max(dd, 1e-30), 0.0, most)
    return u, s


@ti.func
def cell_holds(nodes, x: ti.template(), p):
    """Whether the cell with its corners `nodes` at x holds the point p. It is cut into six tetrahedra around its
    diagonal g, each with two corners b and c that follow each other around it; d = p - corner 0 is inside if
    b · (d × g), c · (g × d) and b · (c × d) are all of the sign of the volume b · (c × g), and their sum is not more.
    All six are looked at, without a branch: a wrong guess which of them it is would cost more.
    """
    a = x[nodes[0]]
    g, d = x[nodes[7]] - a, p - a
    plane = d.cross(g)
    b = x[nodes[AROUND[0]]] - a
    side = b.dot(plane)
    inside = side > side
    for k in ti.static(range(6)):
        c = x[nodes[AROUND[(k + 1) % 6]]] - a
        its_side, normal = c.dot(plane), b.cross(c)
        volume = normal.dot(g)
        sign = ti.select(volume < 0.0, -1.0, 1.0)
        u, v, w = side * sign, -its_side * sign, normal.dot(d) * sign
        inside |= (volume != 0.0) & (ti.min(u, v, w) >= 0.0) & (u + v + w <= ti.abs(volume))
        b, side = c, its_side
    return inside
