"""What of a scene's bodies can touch: points, elements, and where a point inside a solid leaves it (NumPy only)."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.forces.contact_law import shares
from taichi_jello.physics.forces.soft_contact.surface.edge_samples import edges, samples
from taichi_jello.physics.forces.soft_contact.surface.thickness import compact, convex, cores, hearts, thicknesses
from taichi_jello.scene.body import Body

FAR = 1e30  # m
LONGEST = 0.75  # of a convex body's thickness: edges of all of it end in the planes of the sides of one like it
HALVES = np.array([[0, 1, 3], [0, 2, 3]])  # of a face, by the corners of FACES
FACES = np.array([[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 3, 6, 7], [0, 2, 4, 6], [1, 3, 5, 7]])
THIN = 8.0  # times its radius, what a thin body is as thick as: an eighth of that may be passed in a step
THICKNESS = {"sheet": 0.25, "rope": 0.5}  # the radius of a thin body, in lengths of its structural springs


@dataclass(frozen=True)
class Touching:
    """Q points, each a particle of a surface, and E elements: the cells of solid bodies, then the triangles of thin
    ones, then the segments of ropes.

    The first `bare` points are particles of surfaces, the others places Σ weight · x[corner]: up to `skin` points of
    embedded skins, then `samples` between particles. points (Q,): the particle, or the corner with the greatest weight;
    corners, weights (Q - bare, 8); share (Q,): how much of a particle of the surface each stands for; inner (Q,):
    particles, see inner_neighbours.
    nodes (E, 8): particles, the last repeated for triangles and segments; solid: how many elements are cells.
    exits, way (C, 6): the groups of triangles by which a point in a cell may leave, and how far [m] they are through
    the undeformed body, none at an infinite distance; zero where the skin passes through the cell itself. Group g is
    the triangles[start[g]:start[g + 1]], (T, 3) of points, outward where they are a skin's.
    radius (J,) [m] of each jello, zero for solid ones; spacing (J,) [m] between its points.
    thick, core (C,) [m]: how thick the undeformed body is around each cell, and how deep its core begins.
    thickness (J,) [m]: the way through each jello, through half of its cells if it is not convex, THIN times the radius
    of a thin one; compact (J,) bool: convex and not slender, and stays so; slender (J,): solid ones that are not, and
    keep their shape; sheet, rope (J,): sheets and ropes that do; loose (J,): see law.loose.
    hearts (J, 8): the corners of the cell in the middle of each solid one.
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
    radius: np.ndarray
    spacing: np.ndarray
    thick: np.ndarray
    core: np.ndarray
    thickness: np.ndarray
    compact: np.ndarray
    slender: np.ndarray
    sheet: np.ndarray
    rope: np.ndarray
    loose: np.ndarray
    hearts: np.ndarray

    @classmethod
    def of(cls, body: Body, loose: np.ndarray) -> "Touching":
        """loose (J,) bool: see law.loose."""
        jellos = int(body.jello.max()) + 1
        is_solid, is_sheet = np.zeros(jellos, bool), np.zeros(jellos, bool)
        is_solid[body.jello[body.cells[:, 0]]] = True
        is_sheet[body.jello[body.surface[:, 0]]] = True
        is_sheet &= ~is_solid
        thin = body.surface[is_sheet[body.jello[body.surface[:, 0]]]]
        thin = thin[np.unique(np.sort(thin, 1), axis=0, return_index=True)[1]] if len(thin) else thin  # one side
        structural = body.springs[body.family == 0]
        segments = structural[~(is_solid | is_sheet)[body.jello[structural[:, 0]]]]
        is_rope = np.isin(np.arange(jellos), body.jello[segments[:, 0]])
        nodes = np.concatenate(
            [
                body.cells,
                np.concatenate([thin, np.repeat(thin[:, 2:], 5, 1)], 1),
                np.concatenate([segments, np.repeat(segments[:, 1:], 6, 1)], 1),
            ]
        )
        faces, owner, exits, way = ways_out(body.rest, body.cells)
        spacing, holder = _spacing(body, structural, jellos), body.jello[body.cells[:, 0]]
        skinned = body.embedded[body.cells[:, 0]]
        thick = thicknesses(way, skinned, spacing[holder])
        bare = np.unique(
            np.concatenate(
                [
                    faces[~body.embedded[faces[:, 0]]].ravel(),
                    np.flatnonzero(~is_solid[body.jello]),
                    np.flatnonzero(loose[body.jello] & body.inside),
                ]
            )
        )
        point_of = np.full(len(body), -1, np.int32)
        point_of[bare] = np.arange(len(bare))
        start, triangles = np.arange(0, 2 * len(faces) + 1, 2), point_of[faces[:, HALVES]].reshape(-1, 3)
        if len(body.skin):
            which, length, first, members = skin_exits(body, owner, exits, way)
            within = skinned[:, None]
            exits, way = np.where(within, len(faces) + which, exits), np.where(within, length, way)
            start = np.concatenate([start[:-1], len(triangles) + first])
            triangles = np.concatenate([triangles, len(bare) + body.skin[members]])
        radius = spacing * np.select([is_solid, is_sheet], [0.0, THICKNESS["sheet"]], THICKNESS["rope"])
        is_convex = np.array([is_solid[j] and convex(body.rest, body.cells[holder == j]) for j in range(jellos)])
        thickness = THIN * radius
        for j in np.flatnonzero(is_solid):  # where a convex one is thin it only ends
            own = holder == j
            thickness[j] = thick[own].max() if is_convex[j] else max(np.median(thick[own]), spacing[j])
            thick[own] = thickness[j] if is_convex[j] else thick[own]
        open_faces = (~body.embedded & ~loose[body.jello])[faces[:, 0]]
        through = np.array([np.median(thick[holder == j]) if is_solid[j] else np.inf for j in range(jellos)])
        longest = through * np.where(is_convex, LONGEST, 1.0)
        firm = is_solid & ~loose
        longest[is_rope] = LONGEST * through[firm].min(initial=np.inf)  # of all solids: it may lie across any
        ends = np.concatenate([edges(faces[open_faces]), segments[~loose[body.jello[segments[:, 0]]]]])
        between, shared, parts = samples(body.rest, ends, longest[body.jello[ends[:, 0]]])
        corners = np.concatenate([body.skin_corners, between]).astype(np.int32)
        weights = np.concatenate([body.skin_weights, shared])
        main = np.take_along_axis(corners, weights.argmax(1)[:, None], 1)[:, 0]
        points = np.concatenate([bare, main]).astype(np.int32)
        is_compact = np.array([is_convex[j] and compact(body.rest, body.cells[holder == j]) for j in range(jellos)])
        return cls(
            bare=len(bare),
            points=points,
            skin=len(bare) + len(body.skin_corners),
            corners=corners,
            weights=weights,
            share=np.concatenate([np.ones(len(bare)), skin_shares(body), parts]),
            inner=inner_neighbours(body.rest, body.cells)[points],
            nodes=nodes.astype(np.int32),
            solid=len(body.cells),
            exits=np.maximum(exits, 0).astype(np.int32),
            way=np.minimum(way, FAR),
            start=start.astype(np.int32),
            triangles=triangles.astype(np.int32),
            radius=radius,
            spacing=spacing,
            thick=thick,
            core=cores(thick, np.where(skinned, 0.0, spacing[holder])),
            thickness=thickness,
            compact=is_compact & ~loose,
            slender=firm & ~is_compact,
            sheet=is_sheet & ~loose,
            rope=is_rope & ~loose,
            loose=loose,
            hearts=hearts(body.rest, body.cells, holder, jellos),
        )

    @property
    def firm(self) -> np.ndarray:
        """(J,) bool: the solid ones that keep their shape."""
        return self.slender | self.compact

    @property
    def has_slender(self) -> bool:
        """Whether solids of two jellos can hold each other: one is slender, and none is loose."""
        return bool(self.slender.any()) and int(np.sum(self.firm)) > 1

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


def skin_shares(body: Body) -> np.ndarray:
    """(V,) see SkinContact's `shares`; at least half of what is usual, since what presses on a point in all is bounded
    by its share, and on a tiny one next to nothing could."""
    if not len(body.skin):
        return np.zeros(0)
    share = shares(body)
    return np.maximum(share, 0.5 * share.mean())


def skin_exits(body: Body, owner: np.ndarray, exits: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, ...]:
    """For each cell the groups (C, 6) of skin triangles by which it is left and the way (C, 6) to them; and these
    groups: where each starts, and their triangles. The skin is left by its triangles in a cell and in those beside it;
    a cell that it does not pass through, as the cells are in which its straight ways out end; see ways_out."""
    number = {corners.tobytes(): c for c, corners in enumerate(body.cells.astype(np.int32))}
    held = np.array([number[corners.tobytes()] for corners in body.skin_corners.astype(np.int32)])
    members: list[set[int]] = [set() for _ in body.cells]
    for triangle, corners in enumerate(held[body.skin].tolist()):
        for cell in corners:
            members[cell].add(triangle)
    beside = [[b for b in row if b >= 0] for row in _beside(body.cells).tolist()]
    near = [members[c].union(*(members[b] for b in around)) for c, around in enumerate(beside)]
    crossed = body.embedded[body.cells[:, 0]] & ~body.inside[body.cells].all(1)
    crossed[held] = True
    passed = np.flatnonzero(crossed)
    groups = [sorted(near[c] or set().union(*(near[b] for b in beside[c]))) for c in passed]
    group_of = np.full(len(body.cells), -1)
    group_of[passed] = np.arange(len(passed))
    which = group_of[owner[exits]]
    length = np.where(which >= 0, way, np.inf)
    which[passed], length[passed] = group_of[passed, None], np.inf
    length[passed, 0] = 0.0
    start = np.cumsum([0] + [len(group) for group in groups])
    return which, length, start, np.array([triangle for group in groups for triangle in group])


def _spacing(body: Body, structural: np.ndarray, jellos: int) -> np.ndarray:
    """(J,) the mean length of each jello's edges: of its structural springs, else of its cells, else its size."""
    spacing = np.zeros(jellos)
    for j in range(jellos):
        pairs = structural[body.jello[structural[:, 0]] == j]
        if not len(pairs):
            pairs = body.cells[body.jello[body.cells[:, 0]] == j][:, [0, 1]]
        if not len(pairs):
            pairs = body.springs[body.jello[body.springs[:, 0]] == j]
        if len(pairs):
            spacing[j] = np.linalg.norm(body.rest[pairs[:, 0]] - body.rest[pairs[:, 1]], axis=1).mean()
    return np.where(spacing > 0.0, spacing, spacing.max() or 1.0)


def _beside(cells: np.ndarray) -> np.ndarray:
    """(C, 6): the cell across each of FACES, -1 where there is none."""
    _, which, count = np.unique(
        np.sort(cells[:, FACES].reshape(-1, 4), 1), axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(which.ravel(), kind="stable")
    pair = order[count[which.ravel()[order]] == 2].reshape(-1, 2)
    across = np.full(6 * len(cells), -1)
    across[pair] = pair[:, ::-1] // 6
    return across.reshape(-1, 6)


def ways_out(rest: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The six straight ways out of each of the (C, 8) cells, along its own axes: faces (F, 4), the open ones, corner
    2a + b at a, b steps along their axes; owner (F,), their cells; exits (C, 6), the face in which the way down and up
    the x, y and z axis ends; way (C, 6) [m], how long it is in the undeformed body, infinite if it has no end."""
    beside = _beside(cells)
    corners, is_open = cells[:, FACES], beside < 0
    middle = rest[cells].mean(1)
    exits = np.where(is_open, np.cumsum(is_open).reshape(-1, 6) - 1, -1)
    way = np.where(is_open, np.linalg.norm(rest[corners].mean(2) - middle[:, None], axis=2), np.inf)
    side, step = np.indices(exits.shape)[1], np.linalg.norm(middle[beside] - middle[:, None], axis=2)
    while True:
        found = (exits < 0) & (exits[beside, side] >= 0)
        if not found.any():
            break
        way = np.where(found, way[beside, side] + step, way)
        exits = np.where(found, exits[beside, side], exits)
    owner = np.repeat(np.arange(len(cells)), 6).reshape(-1, 6)[is_open]
    return corners[is_open], owner, np.maximum(exits, 0), way


def inner_neighbours(rest: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(N,) for each particle the one opposite to it in the cells around it, the way into the body; itself if there is
    none: the line between the two tells where out is, however the body is turned and bent."""
    around, total = np.zeros(len(rest)), np.zeros_like(rest)
    np.add.at(around, cells, 1.0)
    np.add.at(total, cells, rest[cells].mean(1)[:, None])
    inside = 2.0 * total / np.maximum(around, 1.0)[:, None] - rest
    of, other = np.repeat(cells, 8, axis=1).ravel(), np.tile(cells, 8).ravel()
    distance = np.linalg.norm(rest[other] - inside[of], axis=1)
    order = np.lexsort([other, np.round(distance, 9), of])
    first = order[np.unique(of[order], return_index=True)[1]]
    inner = np.arange(len(rest))
    inner[of[first]] = other[first]
    return inner.astype(np.int32)
