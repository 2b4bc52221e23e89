"""Opens the posterior.zarr of a run in ArviZ and uses it as a reader would; exits non-zero on any failure.

    python check_zarr.py RUN/posterior.zarr

Warnings about the file are failures too.  Prints the versions, one line `mean NAME VALUE` per posterior variable
(every digit, for the Rust test that wrote the file), the summary and the leave-one-out estimates.
"""

import sys
import warnings

import matplotlib

matplotlib.use("Agg")

import arviz as az
import numpy as np
import zarr

NEEDED = {"posterior", "sample_stats", "log_likelihood", "observed_data"}
# Names that ArviZ gives a meaning, with the kind that it expects.
KNOWN_STATS = {
    "lp": "f",
    "energy": "f",
    "acceptance_rate": "f",
    "step_size": "f",
    "diverging": "b",
    "tree_depth": "i",
    "n_steps": "i",
}


def check_groups(run):
    missing = NEEDED - set(run.children)
    assert not missing, f"missing groups: {missing}; found {sorted(run.children)}"
    for name in ("posterior", "sample_stats", "log_likelihood", "posterior_predictive"):
        for variable in run[name].data_vars.values() if name in run.children else ():
            assert variable.dims[:2] == ("chain", "draw"), f"{name}/{variable.name}: {variable.dims}"
    for stat, kind in KNOWN_STATS.items():
        assert stat in run["sample_stats"], f"sample_stats lacks {stat}"
        assert run["sample_stats"][stat].dtype.kind == kind, f"{stat}: {run['sample_stats'][stat].dtype}"
    for name in run["log_likelihood"].data_vars:
        assert name in run["observed_data"], f"observed_data lacks {name}"


def check_use(run):
    table = az.summary(run)
    print(table.to_string())
    assert len(table) >= len(run["posterior"].data_vars), "the summary lacks variables"
    for name in run["log_likelihood"].data_vars:
        estimate = az.loo(run, var_name=name)
        print(f"\nloo {name}\n{estimate}")
        assert np.isfinite(estimate.elpd), f"{name}: elpd {estimate.elpd}"
    scalars = [name for name, v in run["posterior"].data_vars.items() if v.ndim == 2]
    plots = {
        "trace": lambda: az.plot_trace(run, var_names=scalars[:4]),
        "trace_dist": lambda: az.plot_trace_dist(run, var_names=scalars[:4]),
        "ppc_dist": lambda: az.plot_ppc_dist(run),
    }
    for name, plot in plots.items():
        axes = plot().viz["figure"].item().axes
        assert axes and all(len(ax.lines) > 0 for ax in axes), f"plot_{name} drew nothing"


def main(path):
    print(f"python {sys.version.split()[0]}, arviz {az.__version__}, zarr {zarr.__version__}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = az.from_zarr(path)
        run.load()
    print(run)
    check_groups(run)
    for name, variable in run["posterior"].data_vars.items():
        print(f"mean {name} {float(variable.mean())!r} {variable.attrs.get('units', '')}")
    check_use(run)
    print("ok")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
