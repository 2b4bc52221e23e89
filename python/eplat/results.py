"""What a run and a loop leave, read from their folders when asked for."""

from __future__ import annotations

import html
import json
import os
import shutil
import weakref
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _eplat
from .errors import UsageError
from .program import call, failure

if TYPE_CHECKING:
    import pandas
    import pyvista
    import xarray


class Temporary:
    """A folder that is removed when nobody has it any more."""

    def __init__(self, path: Path) -> None:
        self.remove = weakref.finalize(self, shutil.rmtree, path, ignore_errors=True)
        """Removes it now."""


class Answer(NamedTuple):
    """The answer to one question of the verdict."""

    colour: str
    """green, amber or red."""
    sentence: str
    """Its figures in words."""
    remedy: str | None
    """What to do; None where it is green."""


class Verdict(dict[str, Answer]):
    """Up to five answers by question: sampled, fits, physical, informed, trusted."""

    @property
    def colour(self) -> str:
        """The worst of the answers' colours."""
        order = ["green", "amber", "red"]
        return max((answer.colour for answer in self.values()), key=order.index, default="green")

    def __str__(self) -> str:
        lines = [f"Verdict: {self.colour}"]
        for question, answer in self.items():
            lines.append(f"  {question:<9} {answer.colour:<6} {answer.sentence}")
            lines += [f"{'':19}→ {answer.remedy}"] if answer.remedy else []
        return "\n".join(lines)


class Result:
    """A finished run. What it holds is read from its folder when it is asked for."""

    def __init__(self, path: str | os.PathLike[str], _folder: Temporary | None = None) -> None:
        """Opens the folder that `eplat run` left."""
        self.path = Path(path)
        """The folder: report.html, fields.vtp, posterior.zarr and more (docs/outputs.md)."""
        self._folder = _folder  # a temporary folder lasts as long as its result
        if not (self.path / "run.json").is_file():
            raise UsageError(
                f"{self.path} has no run.json: it holds no finished run\n"
                "help: eplat.resume(path) goes on with an interrupted one"
            )

    @cached_property
    def record(self) -> dict[str, Any]:
        """run.json: inputs, settings, versions, times, diagnostics."""
        return json.loads((self.path / "run.json").read_text(encoding="utf-8"))

    @cached_property
    def verdict(self) -> Verdict:
        """Whether to believe the result, and what to do where not."""
        answers = self.record["verdict"]["answers"]
        return Verdict({a["question"]: Answer(a["colour"], a["sentence"], a.get("remedy")) for a in answers})

    @property
    def converged(self) -> bool:
        """Whether the draws come from the posterior."""
        sampled = self.verdict.get("sampled")
        return sampled is None or sampled.colour != "red"

    @cached_property
    def posterior(self) -> xarray.DataTree:
        """All draws and what follows from them, as ArviZ knows it. Needs ArviZ >= 1."""
        import arviz

        return arviz.from_zarr(str(self.path / "posterior.zarr")).load()

    @cached_property
    def maps(self) -> dict[str, NDArray[Any]]:
        """Every map (n_vertices,) by name: `NAME_mean`, `NAME_sd`, `NAME_q5`, … in the unit of NAME.

        Empty for a model without a surface.
        """
        return self._surface[2] if self._surface else {}

    @cached_property
    def mesh(self) -> pyvista.PolyData:
        """The surface (mm) with the maps as point data. Needs pyvista."""
        import pyvista

        if not self._surface:
            raise UsageError(f"{self.path} has no fields.vtp: its model has no surface")
        vertices, triangles, data = self._surface
        mesh = pyvista.PolyData.from_regular_faces(vertices, triangles.astype(np.int64))
        for name, values in data.items():
            mesh.point_data[name] = values
        return mesh

    def summary(self) -> pandas.DataFrame:
        """A line per parameter: mean, sd, quantiles, Monte Carlo error, effective sample sizes, R-hat, unit."""
        return self._table("summary.csv").set_index("name")

    def rows(self) -> pandas.DataFrame:
        """A line per measurement: what was measured, and what is predicted of it."""
        return self._table("rows.csv")

    def predict(self, table: Any, mesh: str | os.PathLike[str] | None = None) -> Forecast:
        """What the run expects of measurements at new rows or sites.

        table: a `pandas.DataFrame` or the path of a CSV, with the columns of the table that was fitted. What was
            measured may be there, and is then compared with what is predicted; its cells may be empty.
        mesh: the file of the run's mesh, if it is no longer where it was.

        Raises `EplatError` with the program's text.
        """
        folder = Path(mkdtemp(prefix="eplat-"))
        kept = Temporary(folder)
        if isinstance(table, (str, os.PathLike)):
            file = os.fspath(table)
        elif hasattr(table, "to_csv"):
            file = str(folder / "table.csv")
            table.to_csv(file, index=False)
        else:
            raise TypeError(f"table: expected a pandas.DataFrame or a path, got {type(table).__name__}")
        arguments = ["predict", str(self.path.absolute()), file, "--out", str(folder)]
        arguments += ["--mesh", os.fspath(mesh)] if mesh is not None else []
        ended, interrupt = call(arguments, lambda _: None, os.getcwd())
        if interrupt:
            raise interrupt
        if ended.code != 0:
            raise failure(ended)
        return Forecast(folder, kept)

    @property
    def report(self) -> Path:
        """The page to look at in a browser."""
        return self.path / "report.html"

    @cached_property
    def _surface(self) -> tuple[NDArray[np.float64], NDArray[np.uint32], dict[str, NDArray[Any]]] | None:
        fields = self.path / "fields.vtp"
        return _eplat.read_surface(fields, "mm") if fields.is_file() else None

    def _table(self, name: str) -> pandas.DataFrame:
        import pandas

        return pandas.read_csv(self.path / name)

    def __repr__(self) -> str:
        return f"<eplat.Result of {self.record['model']}: {self.verdict.colour}, in {self.path}>"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}\n{html.escape(str(self.verdict))}</pre>"


class Forecast:
    """What a run expects at the rows of a table that was not fitted."""

    def __init__(self, path: Path, folder: Temporary | None = None) -> None:
        self.path = path
        """The folder: predictions.csv and predictions.zarr (docs/outputs.md)."""
        self._folder = folder

    @cached_property
    def table(self) -> pandas.DataFrame:
        """A line per row: mean, sd and quantiles of the measurement, and whether what was measured lies inside."""
        import pandas

        return pandas.read_csv(self.path / "predictions.csv")

    @cached_property
    def draws(self) -> xarray.DataTree:
        """Replicated measurements (chain, draw, row) in the group `predictions`. Needs ArviZ >= 1."""
        import arviz

        return arviz.from_zarr(str(self.path / "predictions.zarr")).load()

    def __repr__(self) -> str:
        return f"<eplat.Forecast of {len(self.table)} rows>"


class LoopResult:
    """A closed loop: what the model lacks, and the model with it."""

    def __init__(self, path: str | os.PathLike[str], _folder: Temporary | None = None) -> None:
        """Opens the folder that `eplat loop` left."""
        self.path = Path(path)
        """The folder: report.html, finding.json, the model with what was found, and the fits."""
        self._folder = _folder
        if not (self.path / "finding.json").is_file():
            raise UsageError(f"{self.path} has no finding.json: it holds no closed loop")

    @cached_property
    def finding(self) -> dict[str, Any]:
        """finding.json (docs/outputs.md): `findings` names the columns; `tried` says why others were not claimed."""
        return json.loads((self.path / "finding.json").read_text(encoding="utf-8"))

    @property
    def model(self) -> str | None:
        """Text of the model with what was found; `eplat.run(loop.model, …)` runs it. None if nothing was added."""
        files = sorted(self.path.glob("*_plus_*.rs"))
        return files[0].read_text(encoding="utf-8") if files else None

    @cached_property
    def declared(self) -> Result:
        """The fit of the model as written."""
        return Result(self.path / "declared", self._folder)

    @cached_property
    def before(self) -> Result | None:
        """The fit with what sites and measurements differ by; None where that was not needed."""
        return self._fit("before")

    @cached_property
    def after(self) -> Result | None:
        """The fit with what was found, too; None if nothing was."""
        return self._fit("after")

    @property
    def report(self) -> Path:
        """The page to look at in a browser."""
        return self.path / "report.html"

    def _fit(self, which: str) -> Result | None:
        path = self.path / which
        return Result(path, self._folder) if path.is_dir() else None

    def __repr__(self) -> str:
        found = ", ".join(self.finding["findings"]) or "nothing"
        return f"<eplat.LoopResult: found {found}, in {self.path}>"
