"""The installed package (`pip install .`), on small runs: what Python adds is tested here, not the statistics."""

import signal
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest

import eplat
from eplat.program import PROGRAM

ROOT = Path(__file__).parents[3]
SMALL = dict(chains=2, warmup=150, draws=150)

# a job in the background of a shell begins without Python's own handler, and would never be interrupted
signal.signal(signal.SIGINT, signal.default_int_handler)

# so few draws do not converge, and say so
warnings.simplefilter("ignore", eplat.VerdictWarning)
pytestmark = pytest.mark.filterwarnings("ignore::eplat.VerdictWarning")


def pytest_collection_modifyitems(items):
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("ignore::eplat.VerdictWarning"))


def program(*arguments, cwd=None):
    """Runs the program that came with the package."""
    return subprocess.run([PROGRAM, *map(str, arguments)], cwd=cwd, capture_output=True, text=True)


def draws(folder):
    return (Path(folder) / "draws.csv").read_text()


@pytest.fixture(scope="session")
def synthetic(tmp_path_factory):
    """A run of the shipped ERP model by its name, on a synthetic experiment on the embedded atrium."""
    return eplat.run("erp", out=tmp_path_factory.mktemp("synthetic") / "out", **SMALL)


@pytest.fixture(scope="session")
def table(synthetic):
    """The measurements of that experiment."""
    pandas = pytest.importorskip("pandas")
    return pandas.read_csv(synthetic.path / "measurements.csv")


def sheet(n=9, spacing=5.0):
    """A flat sheet of n × n vertices: (vertices, triangles)."""
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    vertices = spacing * np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    v = (np.arange(n * n).reshape(n, n)[:-1, :-1]).ravel()
    lower = np.stack([v, v + 1, v + n], axis=1)
    upper = np.stack([v + 1, v + n + 1, v + n], axis=1)
    return vertices, np.concatenate([lower, upper])
