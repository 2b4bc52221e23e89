"""Leave-one-out figures of a run's folder against those that ArviZ makes from its posterior.zarr.

A row whose Pareto k is too high was left out in a fit of its own, of which ArviZ knows nothing: its elpd is
another, and the totals are those of the rows as they stand in loo.csv.

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
left_out = numpy.array([row["left_out"] == "true" for row in rows])
high = loo.pareto_k.values > loo.good_k
assert not (left_out & ~high).any(), "a row was left out whose Pareto k is low"
# the log density of the rows under all draws, from which both p_loo are counted
lppd = loo.elpd + loo.p
elpd = numpy.where(left_out, ours, loo.elpd_i.values)
pairs = {
    "pointwise elpd": (elpd, ours),
    "elpd": (elpd.sum(), record["elpd_loo"]),
    "se": (numpy.sqrt(len(elpd) * elpd.var(ddof=1)), record["se"]),
    "p_loo": (lppd - elpd.sum(), record["p_loo"]),
    "k_threshold": (loo.good_k, record["k_threshold"]),
    "n_high_k": ((high & ~left_out).sum(), record["n_high_k"]),
    "n_left_out": (left_out.sum(), record.get("n_left_out", 0)),
    "pareto_k": (loo.pareto_k.values, [float(row["pareto_k"]) for row in rows]),
}
if not left_out.any():
    pairs |= {"ArviZ's elpd": (loo.elpd, elpd.sum()), "ArviZ's se": (loo.se, record["se"])}
for name, (theirs, ours) in pairs.items():
    numpy.testing.assert_allclose(ours, theirs, rtol=1e-9, err_msg=name)
print("ok")
