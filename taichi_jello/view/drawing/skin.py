"""The translucent skin: a fine mesh over the body's surface, and embedded skins, sorted from back to front."""

import numpy as np
import taichi as ti

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.region import places
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.embedded import Embedded
from taichi_jello.view.drawing.primitives import Triangles
from taichi_jello.view.drawing.rows import Array1, Array2, Index1, Index2, face_normal, put, row, vec3
from taichi_jello.view.drawing.shading import EYE, gel
from taichi_jello.view.drawing.subdivide import subdivide

SOFT = 0.06  # of a jello's size: how wide a region's colour fades out


@ti.kernel
def corner_normals(x: Array2, surface: Index2, flat: Array2, start: Index1, face: Index1, corner: Array2):
    """Normals of face corners over smooth neighbours, see FineMesh, from `flat`, the normals of the coarse faces."""
    ti.loop_config(block_dim=1024)
    for t in range(surface.shape[0]):
        put(flat, t, face_normal(x, surface, t))
    ti.loop_config(block_dim=1024)
    for c in range(corner.shape[0]):
        total = vec3(0.0)
        for k in range(start[c], start[c + 1]):
            total += row(flat, face[k])
        put(corner, c, total.normalized(1e-20))


@ti.kernel
def fine_vertices(
    x: Array2, parent: Index2, share: Array2, corner: Array2, start: Index1, item: Index1, weight: Array1,
    points: Array2, normal: Array2,
):  # fmt: skip
    """Fine points and their normals from particles x and the normals of corners; see FineMesh."""
    ti.loop_config(block_dim=1024)
    for i in range(parent.shape[0]):
        p, n = vec3(0.0), vec3(0.0)
        for k in ti.static(range(3)):
            p += share[i, k] * row(x, parent[i, k])
        for k in range(start[i], start[i + 1]):
            n += weight[k] * row(corner, item[k])
        put(points, i, p)
        put(normal, i, n.normalized(1e-20))


@ti.kernel
def shade(x: Array2, normal: Array2, albedo: Array2, index: Index2, camera: Array2, rgba: Array2, away: Array1):
    """Colours of points, and distances of triangles from the eye [m], negative if they show their inner side."""
    ti.loop_config(block_dim=1024)
    for i in range(x.shape[0]):
        color = gel(row(albedo, i), row(x, i), row(normal, i), camera)
        for k in ti.static(range(4)):
            rgba[i, k] = color[k]
    ti.loop_config(block_dim=1024)
    for t in range(index.shape[0]):
        seen = row(x, index[t, 0]) - row(camera, EYE)
        away[t] = seen.norm() if face_normal(x, index, t).dot(seen) < 0.0 else -seen.norm()


class Skin:
    """`triangles` in the order to blend them: the farthest jello first, inner sides before outer ones."""

    def __init__(self, scene: Scene, body: Body, embedded: Embedded | None = None):
        self.surface = np.ascontiguousarray(body.bare_surface, np.int32)
        self.fine = subdivide(body.rest, self.surface) if len(self.surface) else None
        self.embedded = embedded
        jello, index = [np.zeros(0, np.int32)], [np.zeros((0, 3), np.int32)]
        if self.fine is not None:
            jello.append(body.jello[self.fine.parent[:, 0]])
            index.append(self.fine.index)
        self.count = sum(map(len, jello))  # of points over the surface
        if embedded is not None:
            jello.append(embedded.jello)
            index.append(embedded.index + self.count)
        owner, self.index = np.concatenate(jello), np.ascontiguousarray(np.concatenate(index), np.int32)
        self.owner = owner[self.index[:, 0]]
        self.triangles = Triangles.empty(len(owner), self.index)
        self.normal = np.zeros((len(owner), 3), np.float32)
        self._away = np.zeros(len(self.index), np.float32)
        self._flat = np.zeros((len(self.surface), 3), np.float32)
        self._corner = np.zeros((3 * len(self.surface), 3), np.float32)
        self.albedo, self.varied = self._painted(scene, body, owner)

    def _painted(self, scene: Scene, body: Body, owner: np.ndarray) -> tuple[np.ndarray, bool]:
        """(V, 3) float32: display colours of the points, of their jellos and regions; whether any region has one."""
        colors = np.array([palette.skin(jello, number) for number, jello in enumerate(scene.jello)])[owner]
        regions = [(n, part) for n, jello in enumerate(scene.jello) for part in jello.region if part.color is not None]
        if regions:
            rest = np.zeros((len(owner), 3))
            if self.fine is not None:
                rest[: self.count] = np.einsum("vk,vki->vi", self.fine.share, body.rest[self.fine.parent])
            if self.embedded is not None:
                points = np.zeros((len(owner) - self.count, 3), np.float32)
                self.embedded.update(body.rest.astype(np.float32), points)
                rest[self.count :] = points
        for number, part in regions:
            own = owner == number
            share = part.share(places(body.rest[body.jello == number], rest[own]), SOFT)[:, None]
            colors[own] += share * (np.array(part.color) - colors[own])
        return colors.astype(np.float32), bool(regions)

    def place(self, x: np.ndarray, skin: np.ndarray) -> None:
        """Move the vertices to the particles at x (N, 3) and the points of embedded skins at skin (P, 3) [m]."""
        out, fine = self.triangles, self.fine
        if fine is not None:
            corner_normals(x, self.surface, self._flat, fine.corner_start, fine.corner_face, self._corner)
            weights = self._corner, fine.start, fine.item, fine.weight
            fine_vertices(x, fine.parent, fine.share, *weights, out.x[: self.count], self.normal[: self.count])
        if self.embedded is not None:
            out.x[self.count :], self.normal[self.count :] = skin, self.embedded.normals

    def shade(self, camera: np.ndarray) -> None:
        """Colour and sort the triangles where they are now."""
        out = self.triangles
        shade(out.x, self.normal, self.albedo, self.index, camera, out.rgba, self._away)
        out.index = self.index[self._order()]

    def _order(self) -> np.ndarray:
        """(F,) triangles by jello from the farthest, then inner sides first, then by distance from the farthest."""
        away = np.abs(self._away)
        count = np.bincount(self.owner)
        jello = np.bincount(self.owner, weights=away) / np.maximum(count, 1)
        layer = 2 * np.argsort(np.argsort(-jello))[self.owner] + (self._away > 0.0)
        # One integer to sort by: the bits of a non-negative float grow with it.
        return np.argsort((layer << 32) - away.view(np.int32), kind="stable")
