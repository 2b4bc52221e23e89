"""The module in Rust (python/src)."""

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Parts = tuple[NDArray[np.float64], NDArray[np.uint32], dict[str, NDArray[Any]]]
_Told = Callable[[int, int], None] | None

__version__: str

def options(command: str) -> dict[str, str]: ...
def cache_folder() -> os.PathLike[str] | None: ...
def shipped_models() -> dict[str, str]: ...
def read_surface(path: os.PathLike[str], units: str | None = None, piece: int | None = None) -> _Parts: ...
def embedded_surface(edge: float) -> _Parts: ...
def eigenbasis(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64], k: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def simulate_strips(
    parameters: NDArray[np.float64], pacing: dict[str, Any], size: dict[str, Any], restitution: bool, progress: _Told
) -> tuple[dict[str, list[Any]], dict[str, list[Any]]]: ...
def simulate_atrium(
    place: Any, settings: dict[str, Any], progress: _Told
) -> tuple[NDArray[np.float64], NDArray[np.uint32], dict[str, NDArray[np.float64]], str]: ...
