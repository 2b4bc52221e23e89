"""Node-steps per CPU second of TorchCor (pip install torchcor) on the mesh of `cargo bench --bench atrium`.

    eplat mesh atrium --edge 0.32 --out atrium.vtp
    eplat mesh convert --ascii atrium.vtp atrium.vtk
    python benches/atrium_torchcor.py atrium.vtk

The modified Mitchell-Schaeffer cell, float32, Crank-Nicolson and conjugate gradients to 1e-5, dt 0.1 ms, on one
thread of the CPU: the first 60 ms of a beat, of which the first 10 ms, with everything that is done once, are taken
off. A step of TorchCor has one substep of the cell, one of eplat's has five.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
import torchcor as tc
from torchcor.ionic import ModifiedMS2v
from torchcor.simulator import Monodomain

DT = 0.1
# cv_max 0.7 m/s, tau_in 0.05, tau_out 10, tau_open 120, APD_max 200 ms: D = 0.0766 mm²/ms
DIFFUSIVITY, TAU = 0.5 * 0.05 * (0.7 / 0.4) ** 2, dict(tau_in=0.05, tau_out=10.0, tau_open=120.0)


def read(path):
    words = Path(path).read_text().split()
    at = words.index("POINTS")
    n = int(words[at + 1])
    points = np.array(words[at + 3 : at + 3 + 3 * n], float).reshape(n, 3)
    at = words.index("POLYGONS")
    m = int(words[at + 1])
    return points, np.array(words[at + 3 : at + 3 + 4 * m], int).reshape(m, 4)[:, 1:]


def write_carp(folder, points, triangles):
    with open(folder / "atrium.pts", "w") as file:
        file.write(f"{len(points)}\n")
        np.savetxt(file, 1000 * points, fmt="%.3f")
    with open(folder / "atrium.elem", "w") as file:
        file.write(f"{len(triangles)}\n")
        file.writelines(f"Tr {a} {b} {c} 1\n" for a, b, c in triangles)
    with open(folder / "atrium.lon", "w") as file:
        file.write("1\n" + "1 0 0\n" * len(triangles))
    paced = np.flatnonzero(np.linalg.norm(points - points[0], axis=1) < 3)
    (folder / "paced.vtx").write_text(f"{len(paced)}\nextra\n" + "\n".join(map(str, paced)) + "\n")


def cpu_seconds(folder, ms):
    tc.set_device("cpu")
    cell = ModifiedMS2v(DT, None, torch.device("cpu"), torch.float32)
    for name, value in TAU.items():
        setattr(cell, name, value)
    cell.tau_close = 200.0 / np.log1p(10.0 * 0.81 / (4 * 0.05)).item()
    cell.u_gate = cell.u_crit = 0.1
    simulation = Monodomain([cell], T=ms, dt=DT, device=torch.device("cpu"), dtype=torch.float32)
    simulation.load_mesh(path=str(folder), unit_conversion=1000)
    sigma = DIFFUSIVITY * simulation.Chi * simulation.Cm
    simulation.add_conductivity([1], il=sigma, it=sigma)
    simulation.add_stimulus(str(folder / "paced.vtx"), start=0.0, duration=0.9, intensity=100)
    begun = time.process_time()
    u = simulation.solve(
        a_tol=1e-5, r_tol=1e-5, max_iter=100, snapshot_interval=ms, verbose=False, result_path=str(folder / "out")
    )
    return time.process_time() - begun, u[-1]


def main():
    torch.set_num_threads(1)
    points, triangles = read(sys.argv[1])
    folder = Path(tempfile.mkdtemp())
    write_carp(folder, points, triangles)
    (short, _), (long, u) = (cpu_seconds(folder, ms) for ms in (10, 60))
    excited = float((u > -70).float().mean())
    steps = 50 / DT
    print(
        f"{len(points)} vertices, {100 * excited:.0f} % of them excited after 60 ms: {long - short:.1f} CPU s for "
        f"{steps:.0f} steps, {len(points) * steps / (long - short):.2e} node-steps per CPU second"
    )


main()
