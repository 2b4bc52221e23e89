import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import SMALL, draws, program

import eplat

QUESTIONS = ["sampled", "fits", "physical", "informed", "trusted"]


def test_a_model_by_name_gives_maps_a_verdict_and_tables(synthetic):
    assert list(synthetic.verdict) == QUESTIONS
    assert synthetic.verdict["fits"].colour in ("green", "amber", "red")
    assert synthetic.converged == (synthetic.verdict["sampled"].colour != "red")
    assert str(synthetic.verdict).startswith(f"Verdict: {synthetic.verdict.colour}\n  sampled ")
    vertices = eplat.read_mesh("embedded").vertices
    for name in ("erp_s2_mean", "tau_out_sd", "apd_max_q95"):
        assert synthetic.maps[name].shape == (len(vertices),), name
    assert np.all(synthetic.maps["erp_s2_sd"] > 0)
    summary = synthetic.summary()
    assert summary.loc["apd_max.rho", "unit"] == "mm"
    assert len(synthetic.rows()) == 20
    assert "erp.rs" in (synthetic.path / "report.html").read_text() or synthetic.report.is_file()


def test_it_is_the_same_run_as_that_of_the_program(synthetic, tmp_path):
    (tmp_path / "erp.rs").write_text(eplat.model_source("erp"))
    options = [part for name, value in SMALL.items() for part in (f"--{name}", value)]
    done = program("run", "erp.rs", *options, "--out", "out", cwd=tmp_path)
    assert done.returncode in (0, 3), done.stderr
    assert draws(tmp_path / "out") == draws(synthetic.path)


def test_the_posterior_is_one_that_arviz_knows(synthetic):
    arviz = pytest.importorskip("arviz")
    posterior = synthetic.posterior
    assert {"posterior", "sample_stats", "log_likelihood"} <= set(posterior.children)
    assert posterior["posterior"].sizes["draw"] == SMALL["draws"]
    mean = float(posterior["posterior"]["apd_max.rho"].mean())
    assert mean == pytest.approx(synthetic.summary().loc["apd_max.rho", "mean"], rel=1e-9)
    assert len(arviz.summary(posterior)) >= 6


def test_new_rows_are_predicted_from_a_finished_run(synthetic, table):
    new = table.head(3).copy()
    new.loc[new.index[1], ["lower", "upper"]] = np.nan
    forecast = synthetic.predict(new)
    predicted = forecast.table
    assert list(predicted["protocol"]) == list(new["protocol"])
    assert list(predicted["measured_lower"].isna()) == [False, True, False]
    assert np.all(predicted["sd"] > 0) and np.all(predicted["predicted_q5"] < predicted["predicted_q95"])
    with pytest.raises(eplat.EplatError, match="column"):
        synthetic.predict(new.drop(columns=["vertex"]))
    with pytest.raises(TypeError, match="DataFrame"):
        synthetic.predict(3)
    pytest.importorskip("arviz")
    rows = sum(values.shape[2] for values in forecast.draws["predictions"].data_vars.values())
    assert rows == 3


def test_the_mesh_has_the_maps(synthetic):
    pytest.importorskip("pyvista")
    mesh = synthetic.mesh
    assert mesh.is_all_triangles and mesh.n_points == len(synthetic.maps["erp_s2_mean"])
    assert np.array_equal(mesh.point_data["erp_s2_mean"], synthetic.maps["erp_s2_mean"])
    assert mesh.area == pytest.approx(10_118, rel=0.01)  # mm²


def test_a_table_and_a_mesh_in_memory_give_the_same_draws_as_files(synthetic, table, tmp_path):
    csv = synthetic.path / "measurements.csv"
    from_files = eplat.run("erp", "embedded", csv, tmp_path / "files", **SMALL)
    in_memory = eplat.run("erp", "embedded", table, tmp_path / "memory", **SMALL)
    assert draws(in_memory.path) == draws(from_files.path)
    surface = eplat.read_mesh("embedded")
    pair = (surface.vertices, surface.triangles)
    meshes = {"surface": surface, "pair": pair}
    pyvista = pytest.importorskip("pyvista")
    meshes["pyvista"] = pyvista.PolyData.from_regular_faces(*pair)
    for name, mesh in meshes.items():
        result = eplat.run("erp", mesh, table, tmp_path / name, units=None if name == "surface" else "mm", **SMALL)
        assert draws(result.path) == draws(from_files.path), name
    other = table.assign(lower=table.lower + 30, upper=table.upper + 30)
    assert draws(eplat.run("erp", "embedded", other, tmp_path / "other", **SMALL).path) != draws(from_files.path)


def test_a_temporary_folder_lasts_as_long_as_its_result():
    result = eplat.run("erp", **SMALL)
    path = result.path
    assert path.is_dir() and result.maps["erp_s2_mean"].ndim == 1
    del result
    assert not path.exists()


def test_a_model_as_text_or_path_runs_and_options_become_settings(tmp_path):
    text = eplat.model_source("eight_schools")
    path = tmp_path / "schools.rs"
    path.write_text(text)
    data = tmp_path / "schools.csv"
    data.write_text((Path(__file__).parents[3] / "models/eight_schools.csv").read_text())
    by_text = eplat.run(text, data=data, out=tmp_path / "a", seed=3, **SMALL)
    by_path = eplat.run(path, data=data, out=tmp_path / "b", seed=3, **SMALL)
    assert draws(by_text.path) == draws(by_path.path)
    assert by_text.record["seed"] == 3 and by_text.record["settings"]["draws"] == SMALL["draws"]
    assert by_text.maps == {}
    with pytest.raises(eplat.UsageError, match="no surface"):
        by_text.mesh


def test_lists_become_options(tmp_path):
    result = eplat.run(
        "erp", out=tmp_path / "out", sampler="nuts", chains=1, warmup=50, draws=50, exceed=["erp_s2 > 250", "tau_out<5"]
    )
    assert {"P_erp_s2_gt_250", "P_tau_out_lt_5"} <= set(result.maps)
    command = json.loads((tmp_path / "out/inputs/command.json").read_text())["arguments"]
    assert "--sampler=nuts" in command and "--exceed=erp_s2 > 250" in command


def test_progress_is_told_event_by_event(tmp_path):
    told = []
    eplat.run("erp", out=tmp_path / "out", progress=told.append, **SMALL)
    names = [event["event"] for event in told]
    assert names[:4] == ["surface", "basis", "experiment", "sampling"] and "progress" in names


def test_a_red_verdict_warns(tmp_path):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = eplat.run("erp", out=tmp_path / "out", chains=2, warmup=20, draws=20)
    assert not result.converged
    assert any(w.category is eplat.VerdictWarning and "Not converged" in str(w.message) for w in caught)
    assert {w.filename for w in caught} == {__file__}


def test_the_line_of_progress_is_written_over(tmp_path, capsys):
    eplat.run("erp", out=tmp_path / "out", progress=True, **SMALL)
    line = capsys.readouterr().err
    assert line.startswith("\r") and line.endswith("\n") and line.count("\n") == 1
    assert "sampling" in line and "100 %" in line and "now maps, predictions and files" in line
    eplat.run("erp", out=tmp_path / "out", progress=False, **SMALL)
    assert capsys.readouterr().err == ""
