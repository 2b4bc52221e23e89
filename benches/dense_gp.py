"""eplat's integrated sampler beside a dense Gaussian process, on the same points of one surface.

    python -m venv venv && venv/bin/pip install scikit-learn
    cargo build --release
    venv/bin/python benches/dense_gp.py [--mesh SHELL.vtk --units mm] [--points 1000]

Made-up voltages at random vertices, of two truths: one of distances through space, which is what scikit-learn's process
assumes, and one of distances along the surface, which is what eplat's does. As many vertices again are held out. Each
method tells its hyperparameters, the error of its mean at the held-out vertices (against the truth), its log score
there (mean log density of a reading), and its time: wall seconds with all it does, CPU seconds beside.

- `integrated`: `eplat run` of models/voltage.rs with 250 modes, posterior means; `--blocked` adds the blocked sampler,
  which has the same posterior and takes minutes.
- `scikit-learn`: GaussianProcessRegressor, Matern 5/2 through space, maximum likelihood.
- `dense, surface`: the covariance of eplat's own process as a dense matrix, maximum likelihood.
"""

import argparse
import gzip
import json
import resource
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

ROOT = Path(__file__).resolve().parent.parent
NU = 2.5
MODES = 250
TRUTH = {"rho": 33.0, "alpha": 1.2, "noise": 0.4, "mean": 3.0}


def eplat(program, *arguments):
    done = subprocess.run([str(program), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in (0, 4):  # 4: a doubt of the verdict, with all files
        raise SystemExit(done.stderr)
    return done


def spectral_density(w, rho):
    """Matern 5/2 in two dimensions, unit variance."""
    a = 2 * NU / rho**2
    return 4 * np.pi * NU * a**NU / (a + w**2) ** (NU + 1)


def through_space(vertices, rng):
    n, rho = 4000, TRUTH["rho"]
    w = rng.standard_normal((n, 3)) / rho * np.sqrt(2 * NU / rng.chisquare(2 * NU, size=(n, 1)))
    phase = rng.uniform(0, 2 * np.pi, n)
    return np.sqrt(2 / n) * np.cos(vertices @ w.T + phase).sum(1)


def along_surface(values, functions, rng):
    scale = np.sqrt(spectral_density(np.sqrt(np.maximum(values, 0)), TRUTH["rho"]))
    return functions @ (scale * rng.standard_normal(len(values)))


def score(mean, variance, truth, readings):
    error = np.sqrt(np.mean((mean - truth) ** 2))
    ln = -0.5 * ((readings - mean) ** 2 / variance + np.log(2 * np.pi * variance))
    return error, ln.mean()


def cpu():
    own, children = (resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(u.ru_utime + u.ru_stime for u in (own, children))


def by_eplat(sampler, args, folder, name, train, y, test):
    table = folder / f"{name}.csv"
    rows = (f"{v},bipolar,{x:.5f}" for v, x in zip(train, y))
    table.write_text("vertex,protocol,value\n" + "\n".join(rows) + "\n")
    out = folder / f"{name}_{sampler}"
    eplat(args.eplat, "run", folder / "voltage.rs", "--mesh", folder / "surface.obj", "--units", "mm",
          "--data", table, "--sampler", sampler, "--out", out)
    summary = json.loads((out / "summary.json").read_text())
    column = lambda array: np.frombuffer(
        gzip.decompress((out / f"posterior.zarr/fields/voltage_{array}/c/0").read_bytes()), "<f8")
    noise = summary["noise"]["mean"]
    hyper = [summary[k]["mean"] for k in ("voltage.rho", "voltage.alpha", "noise")]
    return hyper, column("mean")[test], column("sd")[test] ** 2 + noise**2


def by_scikit(vertices, train, y, test):
    kernel = ConstantKernel(1.0) * Matern(30.0, (1.0, 300.0), nu=NU) + WhiteKernel(0.1)
    gp = GaussianProcessRegressor(kernel, n_restarts_optimizer=0, random_state=1)
    centre = y.mean()
    gp.fit(vertices[train], y - centre)
    mean, sd = gp.predict(vertices[test], return_std=True)  # the white noise is in it
    k = gp.kernel_
    hyper = [k.k1.k2.length_scale, np.sqrt(k.k1.k1.constant_value), np.sqrt(k.k2.noise_level)]
    return hyper, mean + centre, sd**2


def by_dense_surface(values, functions, train, y, test):
    w = np.sqrt(np.maximum(values, 0))
    phi, there, centre = functions[train], functions[test], y.mean()

    def covariance(theta, a, b):
        rho, alpha, _ = np.exp(theta)
        return (a * (alpha**2 * spectral_density(w, rho))) @ b.T + 9.0 * np.ones((len(a), len(b)))

    def loss(theta):
        k = covariance(theta, phi, phi) + np.exp(2 * theta[2]) * np.eye(len(y))
        factor = cho_factor(k, lower=True)
        half = np.log(np.diag(factor[0])).sum()
        return 0.5 * (y - centre) @ cho_solve(factor, y - centre) + half

    theta = minimize(loss, np.log([30.0, 1.0, 0.3]), method="L-BFGS-B").x
    k = covariance(theta, phi, phi) + np.exp(2 * theta[2]) * np.eye(len(y))
    factor, cross = cho_factor(k, lower=True), covariance(theta, there, phi)
    own = ((there**2) * (np.exp(2 * theta[1]) * spectral_density(w, np.exp(theta[0])))).sum(1) + 9.0
    variance = own - (cross * cho_solve(factor, cross.T).T).sum(1)
    return np.exp(theta), cross @ cho_solve(factor, y - centre) + centre, variance + np.exp(2 * theta[2])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--eplat", default=ROOT / "target/release/eplat", type=Path)
    parser.add_argument("--mesh", type=Path, help="a mesh file [default: the embedded left atrium]")
    parser.add_argument("--units", default="mm")
    parser.add_argument("--points", default=1000, type=int)
    parser.add_argument("--blocked", action="store_true")
    args = parser.parse_args()
    rng = np.random.default_rng(18)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if args.mesh:
            eplat(args.eplat, "mesh", "repair", args.mesh, folder / "surface.obj", "--units", args.units)
        else:
            eplat(args.eplat, "mesh", "atrium", "--out", folder / "surface.obj")
        model = (ROOT / "models/voltage.rs").read_text()
        (folder / "voltage.rs").write_text(model.replace("K = 64", f"K = {MODES}"))
        eplat(args.eplat, "mesh", "basis", folder / "surface.obj", "--units", "mm",
              "--modes", MODES, "--out", folder / "basis.npz")
        eplat(args.eplat, "check", folder / "voltage.rs", "--mesh", folder / "surface.obj", "--units", "mm")
        basis = np.load(folder / "basis.npz")
        values, functions = basis["eigenvalues"], basis["eigenfunctions"]
        lines = (folder / "surface.obj").read_text().splitlines()
        vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)
        print(f"{len(vertices)} vertices, {args.points} points; truth: lengthscale {TRUTH['rho']} mm, "
              f"amplitude {TRUTH['alpha']} mV, noise {TRUTH['noise']} mV\n")
        print("truth          method          lengthscale amplitude noise | error  log score | wall s  CPU s")
        for truth_name, field in [
            ("space", through_space(vertices, rng)),
            ("surface", along_surface(values, functions, rng)),
        ]:
            truth = TRUTH["mean"] + TRUTH["alpha"] * field
            chosen = rng.permutation(len(vertices))[: 2 * args.points]
            train, test = chosen[: args.points], chosen[args.points :]
            readings = truth + TRUTH["noise"] * rng.standard_normal(len(truth))
            y = readings[train]
            for method, run in [
                ("integrated", lambda: by_eplat("integrated", args, folder, truth_name, train, y, test)),
                ("blocked", args.blocked and (
                    lambda: by_eplat("blocked", args, folder, truth_name, train, y, test))),
                ("scikit-learn", lambda: by_scikit(vertices, train, y, test)),
                ("dense, surface", lambda: by_dense_surface(values, functions, train, y, test)),
            ]:
                if not run:
                    continue
                begun, used = time.perf_counter(), cpu()
                (rho, alpha, noise), mean, variance = run()
                wall, used = time.perf_counter() - begun, cpu() - used
                error, ln = score(mean, variance, truth[test], readings[test])
                print(f"{truth_name:14} {method:15} {rho:8.1f} {alpha:9.2f} {noise:8.3f} |"
                      f" {error:.4f} {ln:9.4f} | {wall:6.1f} {used:6.1f}", flush=True)


if __name__ == "__main__":
    main()
