"""What of a scene's bodies can touch: points, elements, and where a point inside a solid leaves it (NumPy only)."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.forces.contact_law import shares
from taichi_jello.physics.forces.soft_contact.surface.edge_samples import edges, samples
from taichi_jello.physics.forces.soft_contact.surface.exits import inner_neighbours, skin_exits, ways_out
from taichi_jello.physics.forces.soft_contact.surface.shapes import Shapes
from taichi_jello.scene.body import Body

FAR = 1e30  # m
LONGEST = 0.75  # of a convex body's thickness: edges of all of it end in the planes of the sides of one like it
HALVES = np.array([[0, 1, 3], [0, 2, 3]])  # the triangles of a face, by the corners of exits.FACES


@dataclass(frozen=True)
class Touching:
    """Q points, each a particle of a surface, and E elements: the cells of solids, the triangles of sheets, the
    segments of ropes.

    The first `bare` points are particles of surfaces, the others places Σ weight · x[corner]: up to `skin` points of
    embedded skins, then samples between particles. points (Q,): the particle, or the corner with the greatest weight;
    corners, weights (Q - bare, 8); share (Q,): the fraction of a surface particle that each stands for; inner (Q,):
    particles, see inner_neighbours.
    nodes (E, 8): particles, the last repeated for triangles and segments; solid: how many elements are cells.
    exits, way (C, 6): the groups of triangles by which a point in a cell may leave, and how far [m] they are through
    the undeformed body, none at an infinite distance; zero where the skin passes through the cell itself. Group g is
    the triangles[start[g]:start[g + 1]], (T, 3) of points, outward where they are a skin's.
    """

    bare: int
    skin: int
    points: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    share: np.ndarray
    inner: np.ndarray
    nodes: np.ndarray
    solid: int
    exits: np.ndarray
    way: np.ndarray
    start: np.ndarray
    triangles: np.ndarray
    shapes: Shapes

    @classmethod
    def of(cls, body: Body, loose: np.ndarray) -> "Touching":
        """loose (J,) bool: see spring_state.loose."""
        faces, owner, exits, way = ways_out(body.rest, body.cells)
        shapes, skinned = Shapes.of(body, loose, way), body.embedded[body.cells[:, 0]]
        segments = body.springs[body.family == 0]
        segments = segments[shapes.rope[body.jello[segments[:, 0]]]]
        bare = np.unique(
            np.concatenate(
                [
                    faces[~body.embedded[faces[:, 0]]].ravel(),
                    np.flatnonzero(~shapes.solid[body.jello]),
                    np.flatnonzero(loose[body.jello] & body.inside),
                ]
            )
        )
        start = np.arange(0, 2 * len(faces) + 1, 2)
        triangles = np.searchsorted(bare, faces[:, HALVES]).reshape(-1, 3)
        if len(body.skin):
            which, length, first, members = skin_exits(body, owner, exits, way)
            within = skinned[:, None]
            exits, way = np.where(within, len(faces) + which, exits), np.where(within, length, way)
            start = np.concatenate([start[:-1], len(triangles) + first])
            triangles = np.concatenate([triangles, len(bare) + body.skin[members]])
        between, shared, parts = _samples(body, shapes, faces, segments)
        corners = np.concatenate([body.skin_corners, between]).astype(np.int32)
        weights = np.concatenate([body.skin_weights, shared])
        main = np.take_along_axis(corners, weights.argmax(1)[:, None], 1)[:, 0]
        points = np.concatenate([bare, main]).astype(np.int32)
        return cls(
            bare=len(bare),
            points=points,
            skin=len(bare) + len(body.skin_corners),
            corners=corners,
            weights=weights,
            share=np.concatenate([np.ones(len(bare)), skin_shares(body), parts]),
            inner=inner_neighbours(body.rest, body.cells)[points],
            nodes=_elements(body, shapes, segments),
            solid=len(body.cells),
            exits=np.maximum(exits, 0).astype(np.int32),
            way=np.minimum(way, FAR),
            start=start.astype(np.int32),
            triangles=triangles.astype(np.int32),
            shapes=shapes,
        )

    def places(self, x: np.ndarray) -> np.ndarray:
        """(Q, 3) [m] where the points are with the particles at x (N, 3)."""
        return np.concatenate([x[self.points[: self.bare]], np.einsum("qk,qkd->qd", self.weights, x[self.corners])])

    def points_of_particles(self, particles: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The points that each particle i is part of: those from first[i] to first[i + 1], and its weight in each."""
        particle = np.concatenate([self.points[: self.bare], self.corners.ravel()])
        point = np.concatenate([np.arange(self.bare), self.bare + np.repeat(np.arange(len(self.corners)), 8)])
        weight = np.concatenate([np.ones(self.bare), self.weights.ravel()])
        order = np.argsort(particle, kind="stable")
        order = order[weight[order] > 0.0]
        return np.searchsorted(particle[order], np.arange(particles + 1)), point[order], weight[order]


def _elements(body: Body, shapes: Shapes, segments: np.ndarray) -> np.ndarray:
    """(E, 8) see Touching.nodes."""
    thin = body.surface[shapes.sheet[body.jello[body.surface[:, 0]]]]
    if len(thin):  # one of the two sides
        thin = thin[np.unique(np.sort(thin, 1), axis=0, return_index=True)[1]]
    wide = [np.pad(nodes, ((0, 0), (0, 8 - nodes.shape[1])), "edge") for nodes in (body.cells, thin, segments)]
    return np.concatenate(wide).astype(np.int32)


def _samples(
    body: Body, shapes: Shapes, faces: np.ndarray, segments: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """See `samples`: on the edges of the faces (F, 4) of solids, and on the segments (S, 2) of ropes, which may lie
    across any solid."""
    holder, through = body.jello[body.cells[:, 0]], np.full(len(shapes.solid), np.inf)
    for j in np.flatnonzero(shapes.solid):
        through[j] = np.median(shapes.thick[holder == j])
    longest = through * np.where(shapes.convex, LONGEST, 1.0)
    longest[shapes.rope] = LONGEST * through[shapes.firm].min(initial=np.inf)
    open_faces = (~body.embedded & ~shapes.loose[body.jello])[faces[:, 0]]
    ends = np.concatenate([edges(faces[open_faces]), segments[~shapes.loose[body.jello[segments[:, 0]]]]])
    return samples(body.rest, ends, longest[body.jello[ends[:, 0]]])


def skin_shares(body: Body) -> np.ndarray:
    """(V,) see SkinContact's `shares`; at least half of what is usual, since what presses on a point in all is bounded
    by its share, and on a tiny one next to nothing could."""
    if not len(body.skin):
        return np.zeros(0)
    share = shares(body)
    return np.maximum(share, 0.5 * share.mean())
