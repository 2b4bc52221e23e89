"""The electrophysiology simulator, in memory: paced strips of tissue, and a paced atrium."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _eplat
from .progress import counted
from .results import Result
from .surface import Surface, read_mesh

if TYPE_CHECKING:
    import pandas
    import pyvista

    from .program import Event

#: Edges of the embedded left atrium in a simulation, mm: short enough for a front.
FINE_EDGE = 0.4
_PARAMETERS = ("cv_max", "tau_in", "tau_out", "tau_open", "apd_max")


@dataclass(frozen=True)
class Strips:
    """What paced strips did: arrays of one value per strip."""

    outcomes: dict[str, NDArray[Any]]
    """By name, with the unit in it: the parameters, then `erp_s2_ms`, `erp_s3_ms`, `cv_s1_m_per_s`, `apd90_s1_ms`, … NaN
    where there is no value; `erp_s2_absence` and `erp_s3_absence` say why."""
    curves: dict[str, NDArray[Any]]
    """One value per beat of a restitution curve: `row` (the strip), `s2_ms`, `cv_m_per_s`, `apd90_ms`, …"""

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.outcomes[name]

    def frame(self) -> pandas.DataFrame:
        """The outcomes as a table. Needs pandas."""
        import pandas

        return pandas.DataFrame(self.outcomes)


def simulate_strip(
    cv_max: ArrayLike = 0.7,
    tau_in: ArrayLike = 0.05,
    tau_out: ArrayLike = 10.0,
    tau_open: ArrayLike = 120.0,
    apd_max: ArrayLike = 200.0,
    *,
    s1: int = 600,
    s2: int = 300,
    beats: int = 8,
    strength: float = 1.0,
    test_strength: float = 2.0,
    shortest: int = 50,
    longest: int = 500,
    length: float = 24.0,
    width: float = 0.6,
    spacing: float = 0.3,
    dt: float = 0.1,
    cable: bool = False,
    restitution: bool = False,
    progress: bool | None | Callable[[Event], None] = None,
) -> Strips:
    """Paces a strip of tissue for every parameter set, and measures CV, APD and ERP in its middle.

    cv_max: m/s; tau_in, tau_out, tau_open, apd_max: ms. Numbers or arrays of one length.
    s1, s2: intervals of the S1 train and of the conditioning S2 of S1S2S3, ms; beats: of the S1 train.
    strength, test_strength: of conditioning stimuli and of the one whose ERP is sought, 1/ms.
    shortest, longest: between which an ERP is sought, ms. It is the largest whole interval that fails.
    length, width, spacing: mm; dt: time step of diffusion, ms. cable: one row of nodes, 2.5 times as fast.
    restitution: also CV and APD of single S2 beats, S2 = 200, 220 … 600 ms; 2.5 times as long.

    The same numbers as `eplat simulate strip`. A set outside the valid ranges is not simulated. On all cores; other
    threads of Python go on.
    """
    columns = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(v, float)) for v in (cv_max, tau_in, tau_out, tau_open, apd_max))
    )
    if columns[0].ndim != 1:
        raise ValueError(f"parameters: expected numbers or arrays (n,), got {columns[0].shape}")
    pacing = dict(s1=s1, s2=s2, beats=beats, strength=strength, test_strength=test_strength)
    pacing |= dict(shortest=shortest, longest=longest)
    size = dict(length=length, width=0.0 if cable else width, spacing=spacing, dt=dt)
    told = counted(progress, "strips")
    parameters = np.ascontiguousarray(np.stack(columns, axis=1))
    outcomes, curves = _eplat.simulate_strips(parameters, pacing, size, restitution, told)
    return Strips(_columns(outcomes), _columns(curves))


@dataclass(frozen=True)
class Beat:
    """The measured beat of a paced surface."""

    surface: Surface
    """What was simulated on, mm, refined if that was asked for."""
    maps: dict[str, NDArray[np.float64]]
    """Values at its vertices by name: the five parameters, LAT and APD20 to APD90 (ms); of several draws means and
    standard deviations. NaN where there is none."""
    record: dict[str, Any]
    """The same in a few numbers, as in simulation.json."""

    @property
    def mesh(self) -> pyvista.PolyData:
        """The surface with the maps as point data. Needs pyvista."""
        import pyvista

        mesh = pyvista.PolyData.from_regular_faces(self.surface.vertices, self.surface.triangles)
        mesh.point_data.update(self.maps)
        return mesh


def simulate_atrium(
    mesh: Any = "embedded",
    *,
    pace: Sequence[int] = (),
    pace_region: tuple[str, float] | None = None,
    cv_max: float | str | NDArray[Any] = 0.7,
    tau_in: float | str | NDArray[Any] = 0.05,
    tau_out: float | str | NDArray[Any] = "tau_out_mean",
    tau_open: float | str | NDArray[Any] = 120.0,
    apd_max: float | str | NDArray[Any] = "apd_max_mean",
    fibres: str | NDArray[Any] | None = None,
    anisotropy: float | None = None,
    refine: int = 0,
    radius: float = 3.0,
    s1: float = 600.0,
    beats: int = 8,
    extra: Sequence[float] = (),
    strength: float = 1.0,
    measure: int | None = None,
    last: float = 600.0,
    dt: float = 0.1,
    double: bool = False,
    draws: int | None = None,
    progress: bool | None | Callable[[Event], None] = None,
) -> Beat:
    """Paces a whole surface with a parameter set at every vertex, and maps activation and recovery.

    mesh: whatever `read_mesh` takes (here "embedded" has edges of 0.4 mm), or an `eplat.Result`, whose maps are the
        parameters. Fronts need edges below 0.5 mm: `refine=N` halves them N times.
    pace: vertices that are paced together, with all closer than `radius` mm; or pace_region: all vertices at which
        point data have a value, such as ("region", 6), the embedded atrium's mitral rim.
    cv_max: m/s; tau_in, tau_out, tau_open, apd_max: ms. A number, an array (n_vertices,) or the name of point data.
    fibres: vectors (n_vertices, 3) or their name, along which conduction is `anisotropy` times as fast as across.
    s1: interval of the S1 train, ms; beats: of it; extra: intervals of further stimuli, ms; strength: 1/ms.
    measure: the beat that is measured, from 1, else the last; last: how long the last beat is followed, ms.
    dt: time step, ms; double: double precision. draws: simulate so many draws of the posterior of a `Result`.

    The same numbers as `eplat simulate atrium`. On all cores; other threads of Python go on, and an interrupt ends it.
    """
    settings: dict[str, Any] = dict(refine=refine, anisotropy=anisotropy, pace=list(map(int, pace)), radius=radius)
    settings |= dict(pace_region=pace_region, s1=s1, beats=beats, extra=list(extra), strength=strength)
    settings |= dict(measure=measure, last=last, dt=dt, double=double, draws=draws)
    if not len(pace) and pace_region is None:
        raise TypeError("simulate_atrium() needs pace=[VERTEX, …] or pace_region=(NAME, VALUE)")
    given = dict(cv_max=cv_max, tau_in=tau_in, tau_out=tau_out, tau_open=tau_open, apd_max=apd_max)
    is_in_memory = any(isinstance(value, np.ndarray) for value in (*given.values(), fibres))
    if isinstance(mesh, Result) and not is_in_memory:
        place: Any = mesh.path
    else:
        place = _arrays(mesh, given, fibres)
    settings |= {name: name if isinstance(value, np.ndarray) else value for name, value in given.items()}
    settings["fibres"] = "fibres" if isinstance(fibres, np.ndarray) else fibres
    told = counted(progress, "time")
    vertices, triangles, maps, record = _eplat.simulate_atrium(place, settings, told)
    return Beat(Surface(vertices, triangles.astype(np.int64), {}), maps, json.loads(record))


def _arrays(mesh: Any, given: Mapping[str, Any], fibres: Any) -> tuple[Any, Any, dict[str, Any], dict[str, Any]]:
    surface = read_mesh(mesh.mesh if isinstance(mesh, Result) else mesh, edge=FINE_EDGE)
    n = len(surface.vertices)
    data = {name: np.asarray(values, float) for name, values in surface.point_data.items()}
    for name, values in [*given.items(), ("fibres", fibres)]:
        if not isinstance(values, np.ndarray):
            continue
        shape = (n, 3) if name == "fibres" else (n,)
        if values.shape != shape:
            raise ValueError(f"{name}: expected an array {shape}, one row per vertex, got {values.shape}")
        data[name] = values.astype(float)
    scalars = {name: values for name, values in data.items() if values.ndim == 1}
    vectors = {name: values for name, values in data.items() if values.ndim == 2 and values.shape[1] == 3}
    return surface.vertices, surface.triangles, scalars, vectors


def _columns(columns: Mapping[str, list[Any]]) -> dict[str, NDArray[Any]]:
    def array(name: str, cells: list[Any]) -> NDArray[Any]:
        if name.endswith("absence"):
            return np.array(cells, dtype=object)
        return np.array([np.nan if cell is None else cell for cell in cells], dtype=float)

    return {name: array(name, cells) for name, cells in columns.items()}
