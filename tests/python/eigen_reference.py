"""Eigenvalues of the clinical shell from an independent assembly and solver.

Makes the reference numbers in tests/manifold_clinical_shell.rs:

    python -m venv venv && venv/bin/pip install scipy pyvista
    venv/bin/python tests/python/eigen_reference.py PATH/TO/openep_la/la_lat.vtk

Stiffness from gradients of the hat functions (not cotangents), lumped mass, largest connected
piece; scipy's eigsh (ARPACK, shift-invert with SuperLU), then Rayleigh quotients.
"""

import sys

import numpy as np
import pyvista
import scipy
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh

N_MODES = 32


def largest_piece(points, triangles):
    """The piece with most vertices, its vertices renumbered in their old order."""
    n = len(points)
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    graph = sp.coo_matrix((np.ones(len(edges)), edges.T), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    keep = label == np.bincount(label).argmax()
    renumbered = np.cumsum(keep) - 1
    return points[keep], renumbered[triangles[keep[triangles[:, 0]]]]


def stiffness_and_mass(points, triangles):
    """K = sum of area grad_i . grad_j, gradients as columns of a pseudo-inverse; M lumped."""
    n = len(points)
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    edges = np.stack([b - a, c - a], axis=1)
    gradient_bc = np.linalg.pinv(edges)
    gradients = np.concatenate([-gradient_bc.sum(axis=2, keepdims=True), gradient_bc], axis=2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    local = area[:, None, None] * np.einsum("tdi,tdj->tij", gradients, gradients)
    rows = np.repeat(triangles, 3, axis=1).ravel()
    columns = np.tile(triangles, (1, 3)).ravel()
    stiffness = sp.coo_matrix((local.ravel(), (rows, columns)), shape=(n, n)).tocsc()
    mass = np.bincount(triangles.ravel(), weights=np.repeat(area / 3, 3), minlength=n)
    return stiffness, mass


def main(path):
    surface = pyvista.read(path)
    points, triangles = largest_piece(
        np.asarray(surface.points, dtype=float), surface.faces.reshape(-1, 4)[:, 1:]
    )
    stiffness, mass = stiffness_and_mass(points, triangles)
    shift = -0.4 * np.pi / mass.sum()
    _, modes = eigsh(stiffness, N_MODES, M=sp.diags(mass).tocsc(), sigma=shift, tol=1e-14)
    quotients = np.einsum("vk,vk->k", modes, stiffness @ modes)
    quotients /= np.einsum("vk,v,vk->k", modes, mass, modes)
    print(f"scipy {scipy.__version__}, numpy {np.__version__}, pyvista {pyvista.__version__}")
    print(f"{len(points)} vertices, {len(triangles)} triangles, area {mass.sum():.10f} mm2")
    for value in np.sort(quotients):
        print(f"{value:.13e}")


if __name__ == "__main__":
    main(sys.argv[1])
