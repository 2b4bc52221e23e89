"""Surfaces: whatever a mesh is given as, and the eigenpairs of its Laplace-Beltrami operator."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _eplat

#: Edges of the embedded left atrium in a run, mm.
EDGE = 1.5


class Surface(NamedTuple):
    """A triangle surface in mm."""

    vertices: NDArray[np.float64]
    """Coordinates (n, 3), mm."""
    triangles: NDArray[np.int64]
    """Vertices of each triangle (m, 3), from 0."""
    point_data: dict[str, NDArray[Any]]
    """Arrays (n,) or (n, k) by name."""


def read_mesh(
    mesh: Any = "embedded", *, units: str | None = None, piece: int | None = None, edge: float = EDGE
) -> Surface:
    """The surface that `mesh` stands for, in mm, as the program reads it.

    `mesh` is a path (VTK, PLY, STL, OBJ, openCARP, .npz), a `pyvista.PolyData`, a pair (vertices, triangles), a
    `Surface`, or "embedded": the procedural left atrium with edges of `edge` mm. Arrays are taken as they are, in mm.
    Of a file, `units` are mm, cm, um or m (else as the file says, or guessed), and `piece` is which connected piece to
    take, from 1.
    """
    if isinstance(mesh, Surface):
        return mesh
    if isinstance(mesh, str) and mesh == "embedded":
        return _surface(*_eplat.embedded_surface(edge))
    if isinstance(mesh, (str, os.PathLike)):
        return _surface(*_eplat.read_surface(Path(mesh), units, piece))
    if hasattr(mesh, "points") and hasattr(mesh, "faces"):
        return _of_pyvista(mesh)
    if isinstance(mesh, (tuple, list)) and len(mesh) == 2:
        vertices, triangles = mesh
        return _surface(vertices, triangles, {})
    raise TypeError(
        "mesh: expected a path, a pyvista.PolyData, a pair (vertices, triangles), a Surface or 'embedded', "
        f"got {type(mesh).__name__}"
    )


def eigenbasis(
    mesh: Any = "embedded", k: int = 24, *, units: str | None = None, piece: int | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The `k` smallest eigenpairs of the surface's Laplace-Beltrami operator.

    Returns eigenvalues (k,), ascending from 0, in 1/mm², and eigenfunctions (n, k) in 1/mm. They are orthonormal under
    the lumped mass matrix: each vertex weighs a third of the area of its triangles, mm². `mesh` is what `read_mesh`
    takes; the rows are the vertices of `read_mesh(mesh)`.
    """
    surface = read_mesh(mesh, units=units, piece=piece)
    return _eplat.eigenbasis(surface.vertices, surface.triangles, k)


def _surface(vertices: Any, triangles: Any, point_data: dict[str, Any]) -> Surface:
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    cells = np.asarray(triangles)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"vertices: expected an array (n, 3), got {points.shape}")
    if cells.ndim != 2 or cells.shape[1] != 3 or cells.dtype.kind not in "iu":
        raise ValueError(f"triangles: expected an array (m, 3) of whole numbers, got {cells.dtype} {cells.shape}")
    return Surface(points, np.ascontiguousarray(cells, dtype=np.int64), point_data)


def _of_pyvista(mesh: Any) -> Surface:
    triangulated = mesh if mesh.is_all_triangles else mesh.triangulate()
    data = {name: np.asarray(values) for name, values in triangulated.point_data.items()}
    numbers = {name: values for name, values in data.items() if values.dtype.kind in "biuf"}
    return _surface(triangulated.points, triangulated.faces.reshape(-1, 4)[:, 1:], numbers)
