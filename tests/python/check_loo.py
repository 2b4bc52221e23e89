"""Leave-one-out figures of a run's folder against those that ArviZ makes from its posterior.zarr.

Where the Pareto k of a row is too high, rows are predicted with the fields integrated out or in fits without them, of
which ArviZ knows nothing: their elpd is another, and the totals are those of the rows as they stand in loo.csv.

Usage: check_loo.py FOLDER; fails unless all agree to 1e-9.
"""

import csv
import json
import sys
import warnings
from pathlib import Path

import arviz
import numpy

warnings.simplefilter("ignore")
folder = Path(sys.argv[1])
loo = arviz.loo(arviz.from_zarr(folder / "posterior.zarr"), pointwise=True)
record = json.loads((folder / "run.json").read_text())["loo"]
with open(folder / "loo.csv", newline="") as file:
    rows = list(csv.DictReader(file))
ours = numpy.array([float(row["elpd"]) for row in rows])
integrated, fit = ([row["loo_by"] == by for row in rows] for by in ("integrated", "fit"))
integrated, fit = numpy.array(integrated), numpy.array(fit)
mended = integrated | fit
high = loo.pareto_k.values > loo.good_k
assert not (fit & ~high).any(), "a fit was made without a row whose Pareto k is low"
assert high.any() or not mended.any(), "weights were not used though every Pareto k is low"
# the log density of the rows under all draws, from which both p_loo are counted
lppd = loo.elpd + loo.p
elpd = numpy.where(mended, ours, loo.elpd_i.values)
pairs = {
    "pointwise elpd": (elpd, ours),
    "elpd": (elpd.sum(), record["elpd_loo"]),
    "se": (numpy.sqrt(len(elpd) * elpd.var(ddof=1)), record["se"]),
    "p_loo": (lppd - elpd.sum(), record["p_loo"]),
    "k_threshold": (loo.good_k, record["k_threshold"]),
    "n_high_k": ((high & ~mended).sum(), record["n_high_k"]),
    "n_integrated": (integrated.sum(), record["n_integrated"]),
    "n_left_out": (fit.sum(), record["n_left_out"]),
    "pareto_k": (loo.pareto_k.values, [float(row["pareto_k"]) for row in rows]),
}
if not mended.any():
    pairs |= {"ArviZ's elpd": (loo.elpd, elpd.sum()), "ArviZ's se": (loo.se, record["se"])}
for name, (theirs, ours) in pairs.items():
    numpy.testing.assert_allclose(ours, theirs, rtol=1e-9, err_msg=name)
print("ok")
