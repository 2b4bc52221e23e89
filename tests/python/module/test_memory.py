"""What works in Python's own process: eigenpairs, strips, a paced surface."""

import os
import signal
import threading

import numpy as np
import pytest
from conftest import program, sheet

import eplat


def lumped_mass(vertices, triangles):
    """A third of the area of its triangles for every vertex, from the cross product."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    mass = np.zeros(len(vertices))
    for k in range(3):
        np.add.at(mass, triangles[:, k], areas / 3)
    return mass


def test_eigenfunctions_are_orthonormal_under_the_mass_matrix():
    surface = eplat.read_mesh("embedded")
    values, functions = eplat.eigenbasis(surface, 12)
    assert values.shape == (12,) and functions.shape == (len(surface.vertices), 12)
    mass = lumped_mass(surface.vertices, surface.triangles)
    gram = functions.T @ (mass[:, None] * functions)
    assert np.abs(gram - np.eye(12)).max() < 1e-8
    # under any other weights they are not
    assert np.abs(functions.T @ functions * mass.mean() - np.eye(12)).max() > 1e-3
    assert abs(values[0]) < 1e-10 and np.all(np.diff(values) > 0)


def test_eigenvalues_of_a_square_are_those_of_the_cosines():
    # Neumann: λ = (π/L)² (i² + j²); linear elements are off by O(h²)
    n, spacing = 41, 0.5
    values, _ = eplat.eigenbasis(sheet(n, spacing), 6)
    side = (n - 1) * spacing
    exact = (np.pi / side) ** 2 * np.array([0, 1, 1, 2, 4, 4])
    assert np.allclose(values, exact, rtol=5e-3, atol=1e-10)


def test_a_mesh_is_the_same_in_each_of_its_forms(tmp_path):
    surface = eplat.read_mesh("embedded")
    np.savez(tmp_path / "mesh.npz", points=surface.vertices, triangles=surface.triangles, mm_per_unit=np.ones(1))
    done = program("mesh", "convert", "mesh.npz", "mesh.vtp", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for mesh in (tmp_path / "mesh.vtp", (surface.vertices, surface.triangles.astype(np.int32)), "embedded"):
        again = eplat.read_mesh(mesh)
        assert np.allclose(again.vertices, surface.vertices, atol=1e-9)
        assert np.array_equal(again.triangles, surface.triangles)
    pyvista = pytest.importorskip("pyvista")
    read = eplat.read_mesh(pyvista.read(tmp_path / "mesh.vtp"))
    assert np.array_equal(read.triangles, surface.triangles)


def test_strips_are_those_of_the_program(tmp_path):
    tau_out, apd_max = np.array([5.0, 10.0, 15.0, 10.0]), np.array([180.0, 200.0, 220.0, 900.0])
    strips = eplat.simulate_strip(tau_out=tau_out, apd_max=apd_max, beats=2, cable=True, restitution=True)
    rows = "".join(f"0.7,0.05,{t},120,{a}\n" for t, a in zip(tau_out, apd_max))
    (tmp_path / "p.csv").write_text("cv_max_m_per_s,tau_in_ms,tau_out_ms,tau_open_ms,apd_max_ms\n" + rows)
    line = "simulate strip --params p.csv --out o.csv --restitution c.csv --beats 2 --cable"
    done = program(*line.split(), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    pandas = pytest.importorskip("pandas")
    for ours, file in ((strips.frame(), "o.csv"), (pandas.DataFrame(strips.curves), "c.csv")):
        theirs = pandas.read_csv(tmp_path / file)
        assert list(ours.columns) == list(theirs.columns) and len(ours) == len(theirs)
        for name in ours.select_dtypes("number"):
            assert np.array_equal(ours[name], theirs[name], equal_nan=True), name
    # the last set is out of range: no value, and a reason
    assert np.isnan(strips["erp_s2_ms"][3]) and "outside its valid range" in strips["erp_s2_absence"][3]
    assert np.all(np.diff(strips["erp_s2_ms"][:3]) > 0) and strips["erp_s2_absence"][0] is None


def test_defaults_of_a_strip_are_those_of_the_program():
    help = program("simulate", "strip", "--help").stdout
    import inspect

    parameters = inspect.signature(eplat.simulate_strip).parameters
    for name in (
        "s1",
        "s2",
        "beats",
        "strength",
        "test_strength",
        "shortest",
        "longest",
        "length",
        "width",
        "spacing",
        "dt",
    ):
        option = help.split(f"--{name.replace('_', '-')} <", 1)[1]
        default = option.split("[default: ", 1)[1].split("]", 1)[0]
        assert float(default) == parameters[name].default, name
    with pytest.raises(eplat.EplatError, match="--width 0.5 is no multiple of the spacing 0.3"):
        eplat.simulate_strip(width=0.5)


def paced_sheet():
    vertices, triangles = sheet(25, 0.4)
    return (vertices, triangles), 150.0 + 5.0 * vertices[:, 0], np.tile([0.0, 1.0, 0.0], (len(vertices), 1))


def test_a_paced_surface_is_that_of_the_program(tmp_path):
    mesh, apd_max, fibres = paced_sheet()
    told = []
    beat = eplat.simulate_atrium(
        mesh,
        pace=[0],
        tau_out=8.0,
        apd_max=apd_max,
        fibres=fibres,
        anisotropy=2.0,
        beats=2,
        s1=320,
        last=320,
        progress=told.append,
    )
    np.savez(tmp_path / "mesh.npz", points=mesh[0], triangles=mesh[1], apd=apd_max, fib=fibres, mm_per_unit=np.ones(1))
    line = "simulate atrium --fields mesh.npz --pace 0 --tau-out 8 --apd-max apd --fibres fib --anisotropy 2 --beats 2"
    done = program(*line.split(), "--s1", 320, "--last", 320, "--out", "beat", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = eplat.read_mesh(tmp_path / "beat/beat.vtp").point_data
    assert {"lat", "apd90"} <= set(beat.maps)
    for name, values in beat.maps.items():
        assert np.allclose(values, theirs[name], equal_nan=True, rtol=1e-6), name
    # it runs along y, the fibres, faster than along x
    lat = beat.maps["lat"].reshape(25, 25)
    assert lat[24, 0] < 0.8 * lat[0, 24]
    assert beat.record["activated_vertices"] == 625
    assert told and told[-1]["of"] == 640
    with pytest.raises(ValueError, match=r"apd_max: expected an array \(625,\), one row per vertex, got \(3,\)"):
        eplat.simulate_atrium(mesh, pace=[0], apd_max=np.ones(3))
    with pytest.raises(TypeError, match="needs pace"):
        eplat.simulate_atrium(mesh)


def test_a_run_is_simulated_with_its_maps_and_draws(synthetic):
    common = dict(pace=[0], beats=1, last=8.0)
    beat = eplat.simulate_atrium(synthetic, **common)
    assert np.allclose(beat.maps["tau_out"], synthetic.maps["tau_out_mean"], rtol=1e-6)
    assert beat.mesh.n_points == len(synthetic.maps["tau_out_mean"])
    drawn = eplat.simulate_atrium(synthetic, draws=2, **common)
    assert drawn.record["draws"] == 2 and any(name.endswith("_sd") for name in drawn.maps)


@pytest.mark.parametrize("work", ["atrium", "strips"])
def test_an_interrupt_ends_it_soon_and_other_threads_run_meanwhile(work):
    told, begun = [], threading.Event()

    def progress(event):
        told.append(event)
        begun.set()

    def interrupt():
        # runs while the simulation does: the interpreter lock is free
        begun.wait()
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt):
        if work == "atrium":
            mesh, apd_max, _ = paced_sheet()
            eplat.simulate_atrium(mesh, refine=1, pace=[0], tau_out=8.0, apd_max=apd_max, beats=90, progress=progress)
        else:
            eplat.simulate_strip(tau_out=np.linspace(2, 29, 5000), progress=progress)
    assert 0 < told[-1]["done"] < 0.5 * told[-1]["of"]
