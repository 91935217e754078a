"""A jello in the shape of a surface mesh from a file: its inside filled with lattice cells, the surface its skin."""

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
from taichi_jello.shapes._meshfile import MeshWarning, flaws, read
from taichi_jello.shapes._skin import FINE, parts, skinned_body, split_edges
from taichi_jello.shapes.lattice import LARGEST

SURE = 0.3  # of a cell, by which a triangle of a surface whose triangles agree must seem to face inwards to be turned
FLAT = 1e-9  # of the cube of a mesh's size: a volume below it is none


@dataclass(frozen=True, kw_only=True)
class Mesh(Jello):
    """The inside of the closed surface in `file` (OBJ, STL, PLY or GLB), filled with cubic cells, `resolution` of them
    along its longest side. `size` [m] of that side, or `scale` [m] of the file's unit; by default the side is 1 m.
    `position` is that of the middle of the box around it."""

    shape: ClassVar[str] = "mesh"
    file: str = ""
    resolution: int = 16
    size: float | None = None
    scale: float | None = None

    def check(self) -> dict[str, Any]:
        if not self.file or (self.size is not None and self.scale is not None):
            key, wanted = ("scale", "either size or scale, got both") if self.file else ("file", "the name of a mesh")
            raise SceneError(key, f"expected {wanted}")
        sizes = {name: getattr(self, name) for name in ("size", "scale") if getattr(self, name) is not None}
        checked: dict[str, Any] = {name: number(name, value, above=0.0) for name, value in sizes.items()}
        checked |= {"file": word("file", self.file), "resolution": whole("resolution", self.resolution, low=1)}
        return super().check() | checked

    def beside(self, folder: Path) -> Jello:
        return dataclasses.replace(self, file=str(folder / self.file))

    def seen_from(self, folder: Path) -> Jello:
        """Files in or below it by their way from there, so that all of it can be moved; others by their whole way."""
        file, folder = Path(self.file).resolve(), folder.resolve()
        return dataclasses.replace(
            self, file=file.relative_to(folder).as_posix() if file.is_relative_to(folder) else str(file)
        )

    def body(self) -> Body:
        points, triangles = read(self.file)
        low, extent = points.min(0), np.ptp(points, axis=0)
        points = (points - low - 0.5 * extent) * (self.scale or (self.size or 1.0) / extent.max())
        spacing = float(np.ptp(points, axis=0).max()) / self.resolution
        shape = self._grid(points, spacing)
        opened, twisted = flaws(points, triangles)
        filled, fraction, within = self._filled(points, triangles, spacing, shape, not twisted)
        enclosed_volume = volume(points, triangles)
        # A closed surface may be thinner than the samples: it makes a body of the cells that it passes through.
        if not fraction.any() and (opened or twisted or abs(enclosed_volume) < FLAT * np.ptp(points) ** 3):
            raise SceneError("file", f"{self.file}: expected a closed surface, nothing is inside")
        if enclosed_volume < 0.0 and not twisted:
            triangles = triangles[:, ::-1]
        triangles = outward(points / spacing + 0.5 * np.array(shape), triangles, within, 0.0 if twisted else SURE)
        if opened or twisted:
            wrong = f"{opened} edges of its surface are open" * bool(opened)
            wrong += " and " * bool(opened and twisted) + "its triangles do not all face outwards" * bool(twisted)
            self._warn(f"{wrong}; what is inside was put to the vote of rays")
        elif enclosed_volume < 0.0:
            self._warn("its triangles all face inwards; they were turned")
        self._look_for_loose_parts(points, triangles, filled, not twisted)
        points, triangles = split_edges(points, triangles, FINE * spacing)
        return skinned_body(self, points, triangles, filled, fraction, spacing, within >= 0.5)

    def _grid(self, points: np.ndarray, spacing: float) -> tuple[int, ...]:
        """Cells along each axis."""
        shape = tuple(max(1, int(n)) for n in np.ceil(np.ptp(points, axis=0) / spacing - 1e-6))
        made = prod(n + 1 for n in shape)
        if made > LARGEST:
            most = int(self.resolution * (LARGEST / made) ** (1.0 / 3.0))
            raise SceneError(
                "resolution", f"expected at most {most}, {self.resolution} makes a grid of {made:,} points"
            )
        return shape

    def _filled(
        self, points: np.ndarray, triangles: np.ndarray, spacing: float, shape: tuple[int, ...], signed: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The cells (n, m, l) that the surface meets or encloses; how much of each is inside, and of what is around
        each corner (n+1, m+1, l+1)."""
        from taichi_jello.shapes._voxels import voxelised

        return voxelised(points / spacing + 0.5 * np.array(shape), triangles, shape, signed)

    def _look_for_loose_parts(
        self, points: np.ndarray, triangles: np.ndarray, filled: np.ndarray, signed: bool
    ) -> None:
        """Warn if cells do not hang together, and say which coarser resolution joins them."""
        sizes = parts(filled)
        if len(sizes) == 1:
            return
        joined, resolution = 0, self.resolution
        while resolution > 2 and not joined:
            resolution = int(0.8 * resolution)
            spacing = float(np.ptp(points, axis=0).max()) / resolution
            coarse = self._filled(points, triangles, spacing, self._grid(points, spacing), signed)[0]
            joined = resolution if len(parts(coarse)) == 1 else 0
        cure = f"resolution = {joined} joins them" if joined else "they are too far apart for any resolution"
        self._warn(
            f"falls into {len(sizes)} parts, {sum(sizes[1:])} of {sum(sizes)} cells do not hang on the largest; {cure}"
        )

    def _warn(self, text: str) -> None:
        warnings.warn(f"{self.file}: {text}", MeshWarning, stacklevel=2)


def volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """What outward triangles enclose [m³]."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def outward(places: np.ndarray, triangles: np.ndarray, within: np.ndarray, sure: float) -> np.ndarray:
    """The triangles with those turned that face inwards: half a cell along their normal there is more inside, by more
    than `sure` of a cell, than half a cell the other way. places (V, 3) in cells."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    front, back = (_interpolated(within, (a + b + c) / 3.0 + step * normal) for step in (0.5, -0.5))
    return np.where((front > back + sure)[:, None], triangles[:, ::-1], triangles)


def _interpolated(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (n, m, l) at the grid's points, trilinearly between them."""
    places = np.clip(places, 0.0, np.array(values.shape) - 1.0)
    cell = np.minimum(places.astype(int), np.array(values.shape) - 2)
    total, at = np.zeros(len(places)), places - cell
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, at, 1.0 - at).prod(1)
        total += weight * values[tuple((cell + corner).T)]
    return total
