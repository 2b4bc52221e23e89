"""Runs and loops: inputs become files, settings become options, and the program does the rest."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, TypeVar

import numpy as np

from .errors import EplatError, Interrupted, UsageError, VerdictWarning
from .models import model_file
from .program import Event, call, failure
from .progress import Line, shown
from .results import LoopResult, Result, Temporary
from .settings import arguments
from .surface import Surface, read_mesh

# Inputs that were given in memory, and the command; beside the results, so that a run can be gone on with.
INPUTS = "inputs"
COMMAND = "command.json"
INTERRUPTED = (130, 131)
#: Exit codes after which there is a result, with what its verdict says.
DONE = (0, 3, 4)
#: Events that tell of something lost.
LOST = ("chain_failed", "not_kept", "doubts")

_Path = str | os.PathLike[str]
_Kind = TypeVar("_Kind", Result, LoopResult)


def run(
    model: _Path,
    mesh: Any = None,
    data: Any = None,
    out: _Path | None = None,
    *,
    progress: bool | None | Callable[[Event], None] = None,
    **settings: Any,
) -> Result:
    """Samples a model's posterior.

    model: the name of a model that ships ("erp"; see `eplat.models()`), a path (.rs), or source text. Only one
        with Rust code in it is compiled first, which needs a Rust toolchain.
    mesh: a path, a `pyvista.PolyData`, a pair (vertices (n, 3), triangles (m, 3)), an `eplat.Surface`, or "embedded",
        the procedural left atrium. The unit of a file or of arrays is what the file says, `units="mm"`, or guessed
        from the size.
    data: a `pandas.DataFrame` or the path of a CSV: one row per measurement, with vertex or x, y, z; protocol; lower and
        upper, or value; and any further columns. Without it: a synthetic experiment on the mesh.
    out: the folder for all files. Without it: a temporary one, which is removed with the result.
    progress: None shows a line on a terminal and in a notebook, True always, False never; a function is called with
        every event (docs/outputs.md).
    settings: the options of `eplat run`, with underscores: chains=4, warmup=1000, draws=1000, seed=1,
        laplace=True, exceed=["erp_s2 > 250"], resume=True, …

    Raises `EplatError` with the program's text; `TypeError` for a setting that does not exist; `Interrupted`, which is a
    `KeyboardInterrupt`, after which `eplat.resume(error.path)` goes on. Warns with `VerdictWarning` if the verdict is
    red.
    """
    job = _Call("run", out, arguments("run", settings))
    job.inputs(model, mesh, data, units=settings.get("units"))
    return job.result(Result, progress)


def loop(
    model: _Path,
    mesh: Any = None,
    data: Any = None,
    heldout: Any = None,
    out: _Path | None = None,
    *,
    progress: bool | None | Callable[[Event], None] = None,
    **settings: Any,
) -> LoopResult:
    """Finds what a model lacks, adds it, and tells the error before and after.

    heldout: measurements that play no part in the search, as a DataFrame or a path; the errors before and after are
        theirs. Without it: each site is predicted from the others.
    settings: the options of `eplat loop`: nulls=99 searches on simulated data, seed=1,
        column={"age": "unit"} for what a column means, …

    The rest is as in `eplat.run`. An interrupted loop goes on with the same call, `out` its folder and resume=True.
    """
    job = _Call("loop", out, arguments("loop", settings))
    job.inputs(model, mesh, data, units=settings.get("units"))
    if heldout is not None:
        job.arguments += ["--heldout", job.table(heldout, "heldout")]
    return job.result(LoopResult, progress)


def resume(path: _Path, *, progress: bool | None | Callable[[Event], None] = None) -> Result:
    """Goes on with a run of `eplat.run` that was interrupted, to the same numbers as without the interruption.

    path: its folder, which `Interrupted` tells. A run that is complete is read.
    """
    command = Path(path) / INPUTS / COMMAND
    if not command.is_file():
        raise UsageError(
            f"{path} holds no run of eplat.run\nhelp: after `eplat run` give its command again with --resume"
        )
    job = _Call("run", path, [])
    job.again(json.loads(command.read_text(encoding="utf-8")))
    return job.result(Result, progress)


class _Call:
    """One call of the program, and the folder that it writes."""

    def __init__(self, command: str, out: _Path | None, options: list[str]) -> None:
        self._temporary = out is None
        self.out = Path(mkdtemp(prefix="eplat-")) if out is None else Path(out).absolute()
        self.arguments = [command, *options]
        self._folder = os.getcwd()

    def inputs(self, model: _Path, mesh: Any, data: Any, units: str | None) -> None:
        """Names the inputs; those in memory are written beside the results."""
        try:
            self.arguments.insert(1, str(model_file(model)))
            if mesh is not None:
                self.arguments += ["--mesh", self._mesh(mesh, units)]
            if data is not None:
                self.arguments += ["--data", self.table(data, "data")]
            self.arguments += ["--out", str(self.out)]
            command = {"arguments": self.arguments, "folder": self._folder}
            self._file(COMMAND).write_text(json.dumps(command), encoding="utf-8")
        except BaseException:
            self._discard()
            raise

    def again(self, command: dict[str, Any]) -> None:
        """Takes the arguments of an earlier call, to go on with its run."""
        self.arguments, self._folder = command["arguments"], command["folder"]
        if "--resume" not in self.arguments:
            self.arguments.append("--resume")

    def table(self, table: Any, name: str) -> str:
        """The file of a table."""
        if isinstance(table, (str, os.PathLike)):
            return os.fspath(table)
        if not hasattr(table, "to_csv"):
            self._discard()
            raise TypeError(f"{name}: expected a pandas.DataFrame or a path, got {type(table).__name__}")
        file = self._file(f"{name}.csv")
        table.to_csv(file, index=False)
        return str(file)

    def _mesh(self, mesh: Any, units: str | None) -> str:
        if isinstance(mesh, (str, os.PathLike)):
            return os.fspath(mesh)
        surface = read_mesh(mesh)
        arrays: dict[str, Any] = {f"point_data/{name}": values for name, values in surface.point_data.items()}
        if isinstance(mesh, Surface) and units is None:
            arrays["mm_per_unit"] = np.ones(1)
        file = self._file("mesh.npz")
        np.savez(file, points=surface.vertices, triangles=surface.triangles, **arrays)
        return str(file)

    def _file(self, name: str) -> Path:
        folder = self.out / INPUTS
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise EplatError(f"cannot write to {self.out}: {error}\nhelp: name another folder with out=") from error
        return folder / name

    def result(self, kind: type[_Kind], progress: Any) -> _Kind:
        """Calls the program; what it left, unless it failed."""
        show = shown(progress)
        lost: list[str] = []

        def on_event(event: Event) -> None:
            lost.extend([event["text"]] if event["event"] in LOST else [])
            show(event)

        ended, interrupt = call(self.arguments, on_event, self._folder)
        if isinstance(show, Line):
            show.end()
        if interrupt or ended.code in INTERRUPTED:
            raise self._interrupted(interrupt, ended.code in DONE) from None
        if ended.code not in DONE:
            self._discard()
            raise failure(ended)
        result = kind(self.out, Temporary(self.out) if self._temporary else None)
        for text in lost:
            warnings.warn(text, VerdictWarning, stacklevel=3)
        if isinstance(result, Result) and result.verdict.colour == "red":
            warnings.warn(str(result.verdict), VerdictWarning, stacklevel=3)
        return result

    def _interrupted(self, interrupt: BaseException | None, is_done: bool) -> BaseException:
        is_kept = (self.out / "checkpoint").is_dir()
        if not is_done and not is_kept:
            self._discard()
        if interrupt and not isinstance(interrupt, KeyboardInterrupt):
            return interrupt
        if is_done:
            text = f"interrupted, but it was done: its files are in {self.out}"
        elif is_kept:
            text = f"interrupted: the run is kept; go on with eplat.resume({str(self.out)!r})"
        else:
            text = "interrupted before there was anything to keep"
        return Interrupted(text, self.out)

    def _discard(self) -> None:
        if self._temporary:
            Temporary(self.out).remove()
