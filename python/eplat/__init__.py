"""eplat in Python: calibrate maps of cardiac tissue from a few measurements.

    import eplat

    result = eplat.run("erp", mesh="atrium.vtp", data=table)   # table: a pandas DataFrame
    print(result.verdict)                                      # whether to believe it
    result.posterior                                           # an ArviZ DataTree
    result.maps["erp_s2_mean"]                                 # ms, at every vertex
    result.mesh.plot(scalars="erp_s2_mean")                    # a pyvista.PolyData

`run` samples a model, `loop` finds what it lacks, `resume` goes on where a run was interrupted. `simulate_strip`,
`simulate_atrium` and `eigenbasis` work in memory. Lengths are mm and times ms throughout.
"""

from ._eplat import __version__
from .errors import CrashError, EplatError, Interrupted, UsageError, VerdictWarning
from .models import model_source, models
from .results import Answer, Forecast, LoopResult, Result, Verdict
from .runs import loop, resume, run
from .simulator import Beat, Strips, simulate_atrium, simulate_strip
from .surface import Surface, eigenbasis, read_mesh

__all__ = [
    "Answer",
    "Beat",
    "CrashError",
    "EplatError",
    "Forecast",
    "Interrupted",
    "LoopResult",
    "Result",
    "Strips",
    "Surface",
    "UsageError",
    "Verdict",
    "VerdictWarning",
    "__version__",
    "eigenbasis",
    "loop",
    "model_source",
    "models",
    "read_mesh",
    "resume",
    "run",
    "simulate_atrium",
    "simulate_strip",
]
