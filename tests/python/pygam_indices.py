"""Sensitivity indices by pygam 0.12.0 (pip install pygam), the reference of tests/surrogate_sensitivity.rs.

    python tests/python/pygam_indices.py tests/tables/sensitivity_500.csv
"""

import csv
import sys

import numpy as np
from pygam import LinearGAM, s

INPUTS = ["cv_max_m_per_s", "tau_in_ms", "tau_out_ms", "tau_open_ms", "apd_max_ms"]

with open(sys.argv[1]) as file:
    rows = list(csv.DictReader(file))
for output in ["erp_s2_ms", "erp_s3_ms"]:
    kept = [r for r in rows if r["erp_s2_ms"] and r[output] and float(r["erp_s2_ms"]) <= 280]
    x = np.array([[float(r[name]) for name in INPUTS] for r in kept])
    y = np.array([float(r[output]) for r in kept])
    terms = s(0, n_splines=10)
    for i in range(1, 5):
        terms += s(i, n_splines=10)
    gam = LinearGAM(terms).gridsearch(x, y, progress=False)
    indices = [np.var(gam.partial_dependence(i, X=x)) / np.var(y) for i in range(5)]
    edof = gam.statistics_["edof"]
    print(output, len(y), f"lam {gam.lam[0][0]:.4g} edof {edof:.3f}", " ".join(f"{v:.5f}" for v in indices))
