"""Leave-one-out figures of a run's folder against those that ArviZ makes from its posterior.zarr.

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
pairs = {
    "elpd": (loo.elpd, record["elpd_loo"]),
    "se": (loo.se, record["se"]),
    "p_loo": (loo.p, record["p_loo"]),
    "k_threshold": (loo.good_k, record["k_threshold"]),
    "n_high_k": ((loo.pareto_k.values > loo.good_k).sum(), record["n_high_k"]),
    "pointwise elpd": (loo.elpd_i.values, [float(row["elpd"]) for row in rows]),
    "pareto_k": (loo.pareto_k.values, [float(row["pareto_k"]) for row in rows]),
}
for name, (theirs, ours) in pairs.items():
    numpy.testing.assert_allclose(ours, theirs, rtol=1e-9, err_msg=name)
print("ok")
