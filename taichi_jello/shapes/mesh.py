"""A jello in the shape of a surface mesh from a file: lattice cells fill its inside, the surface is its skin."""

import dataclasses
import warnings
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Jello
from taichi_jello.scene.validation import SceneError, number, whole, word
from taichi_jello.shapes._meshfiles.reading import flaws, read
from taichi_jello.shapes._meshfiles.stl import MeshWarning
from taichi_jello.shapes._skin import MAX_EDGE, parts, skinned_body, split_edges
from taichi_jello.shapes.lattice import MAX_PARTICLES

SURE = 0.3  # of a cell: by how much a triangle of a consistently oriented mesh must seem to face inwards to be flipped
FLAT = 1e-9  # of the cube of a mesh's size: smaller volumes count as zero


@dataclass(frozen=True, kw_only=True)
class Mesh(Jello):
    """The inside of the closed surface in `file` (OBJ, STL, PLY or GLB), filled with cubic cells, `resolution` of them
    along its longest side. `size` [m] of that side, or `scale` [m] of the file's unit; by default the side is 1 m.
    `position` is that of the centre of its bounding box."""

    shape: ClassVar[str] = "mesh"
    file: str = ""
    resolution: int = 16
    size: float | None = None
    scale: float | None = None

    def check(self) -> dict[str, Any]:
        if not self.file:
            raise SceneError("file", "expected the name of a mesh")
        if self.size is not None and self.scale is not None:
            raise SceneError("scale", "expected either size or scale, got both")
        checked: dict[str, Any] = super().check()
        for name in ("size", "scale"):
            if getattr(self, name) is not None:
                checked[name] = number(name, getattr(self, name), above=0.0)
        return checked | {"file": word("file", self.file), "resolution": whole("resolution", self.resolution, low=1)}

    def with_files_in(self, folder: Path) -> Jello:
        return dataclasses.replace(self, file=str(folder / self.file))

    def with_files_relative_to(self, folder: Path) -> Jello:
        """Files in or below the folder get relative paths, so it can be moved; others absolute ones."""
        file, folder = Path(self.file).resolve(), folder.resolve()
        path = file.relative_to(folder).as_posix() if file.is_relative_to(folder) else str(file)
        return dataclasses.replace(self, file=path)

    def body(self) -> Body:
        points, triangles = read(self.file)
        low, extent = points.min(0), np.ptp(points, axis=0)
        points = (points - low - 0.5 * extent) * (self.scale or (self.size or 1.0) / extent.max())
        opened, twisted = flaws(points, triangles)
        filled, fraction, within, spacing = self._voxels(points, triangles, self.resolution, not twisted)
        enclosed = volume(points, triangles)
        # A closed surface may be thinner than the samples: then its body is the cells that it passes through.
        if not fraction.any() and (opened or twisted or abs(enclosed) < FLAT * np.ptp(points) ** 3):
            raise SceneError("file", f"{self.file}: expected a closed surface, nothing is inside")
        if enclosed < 0.0 and not twisted:
            triangles = triangles[:, ::-1]
        sure = 0.0 if twisted else SURE
        triangles = outward(points / spacing + 0.5 * np.array(filled.shape), triangles, within, sure)
        if opened or twisted:
            open_edges = [f"{opened} edges of its surface are open"] * bool(opened)
            faces = ["its triangles do not all face outwards"] * bool(twisted)
            self._warn(f"{' and '.join(open_edges + faces)}; a majority of rays decided what is inside")
        elif enclosed < 0.0:
            self._warn("its triangles all face inwards; they were turned")
        self._check_connected(points, triangles, filled, not twisted)
        points, triangles = split_edges(points, triangles, MAX_EDGE * spacing)
        return skinned_body(self, points, triangles, filled, fraction, spacing, within >= 0.5)

    def _voxels(
        self, points: np.ndarray, triangles: np.ndarray, resolution: int, signed: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """`voxelised` on a grid of cells with `resolution` along the longest side, and their width [m]."""
        from taichi_jello.shapes._voxels import voxelised

        spacing = float(np.ptp(points, axis=0).max()) / resolution
        shape = tuple(max(1, int(n)) for n in np.ceil(np.ptp(points, axis=0) / spacing - 1e-6))
        count = prod(n + 1 for n in shape)
        if count > MAX_PARTICLES:
            most = int(resolution * (MAX_PARTICLES / count) ** (1.0 / 3.0))
            raise SceneError("resolution", f"expected at most {most}, {resolution} makes a grid of {count:,} points")
        return *voxelised(points / spacing + 0.5 * np.array(shape), triangles, shape, signed), spacing

    def _check_connected(self, points: np.ndarray, triangles: np.ndarray, filled: np.ndarray, signed: bool) -> None:
        """Warn of disconnected cells, with the coarser resolution that connects them."""
        sizes, resolution = parts(filled), self.resolution
        if len(sizes) == 1:
            return
        cure = "they are too far apart for any resolution"
        while resolution > 2:
            resolution = int(0.8 * resolution)
            if len(parts(self._voxels(points, triangles, resolution, signed)[0])) == 1:
                cure = f"resolution = {resolution} joins them"
                break
        self._warn(f"falls into {len(sizes)} parts, {sum(sizes[1:])} of {sum(sizes)} cells are loose; {cure}")

    def _warn(self, text: str) -> None:
        warnings.warn(f"{self.file}: {text}", MeshWarning, stacklevel=2)


def volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """The volume [m³] inside outward triangles."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def outward(places: np.ndarray, triangles: np.ndarray, within: np.ndarray, sure: float) -> np.ndarray:
    """The triangles, flipped where they face inwards: where half a cell along the normal there is more inside, by more
    than `sure` of a cell, than half a cell the other way. places (V, 3) in cells."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    front, back = (_interpolated(within, (a + b + c) / 3.0 + step * normal) for step in (0.5, -0.5))
    return np.where((front > back + sure)[:, None], triangles[:, ::-1], triangles)


def _interpolated(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Trilinear interpolation of the values (n, m, l) at the grid's points."""
    places = np.clip(places, 0.0, np.array(values.shape) - 1.0)
    cell = np.minimum(places.astype(int), np.array(values.shape) - 2)
    total, at = np.zeros(len(places)), places - cell
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, at, 1.0 - at).prod(1)
        total += weight * values[tuple((cell + corner).T)]
    return total
