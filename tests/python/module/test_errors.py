import subprocess
import sys
from pathlib import Path

import pytest
from conftest import SMALL, draws, program

import eplat


def test_an_error_is_the_text_of_the_program(tmp_path):
    with pytest.raises(eplat.EplatError) as raised:
        eplat.run("erp", "embedded", tmp_path / "none.csv")
    said = program(
        "run", "models/erp.rs", "--mesh", "embedded", "--data", tmp_path / "none.csv", cwd=Path(__file__).parents[3]
    )
    assert said.stderr.endswith(f"error: {raised.value}\n") and said.returncode == 1
    assert not isinstance(raised.value, eplat.UsageError)


def test_a_table_with_a_mistake_names_row_and_column(table):
    wrong = table.assign(lower=table.lower.astype(object))
    wrong.loc[3, "lower"] = "often"
    with pytest.raises(eplat.EplatError, match=r"line 5.*lower"):
        eplat.run("erp", "embedded", wrong)


def test_an_unknown_setting_names_near_ones():
    with pytest.raises(TypeError, match=r"eplat.run\(\) has no setting 'drws'\nhelp: did you mean draws\?"):
        eplat.run("erp", drws=100)
    with pytest.raises(TypeError, match="there is .*nulls"):
        eplat.loop("erp", qqqq=1)
    with pytest.raises(TypeError, match="prior: expected True or False, got 3"):
        eplat.run("erp", prior=3)
    with pytest.raises(TypeError, match="draws: expected one value"):
        eplat.run("erp", draws=[1, 2])
    with pytest.raises(TypeError, match="a mode has no draws"):
        eplat.run("erp", optimize=True)


def test_a_setting_that_makes_no_sense_is_the_programs_own_error():
    with pytest.raises(eplat.UsageError, match="invalid value 'many' for '--draws"):
        eplat.run("erp", draws="many")
    with pytest.raises(eplat.UsageError, match="--data without --mesh"):
        eplat.run("erp", data="some.csv")


def test_a_model_that_is_none():
    with pytest.raises(eplat.UsageError, match="no model 'epr'.*\nhelp: there is erp"):
        eplat.run("epr")
    with pytest.raises(eplat.EplatError, match="cannot read the model file none.rs"):
        eplat.run("none.rs")
    with pytest.raises(eplat.EplatError, match=r"unknown name `Nromal`"):
        eplat.run("use eplat::prelude::*;\nmodel! {\n    model M;\n    param a ~ Nromal(0, 1);\n}\n")


def test_things_that_are_no_mesh_and_no_table():
    with pytest.raises(TypeError, match="mesh: expected a path.*got int"):
        eplat.run("erp", 3)
    with pytest.raises(TypeError, match="data: expected a pandas.DataFrame or a path, got list"):
        eplat.run("erp", "embedded", [1, 2])
    with pytest.raises(ValueError, match=r"triangles: expected an array \(m, 3\) of whole numbers, got float64"):
        eplat.eigenbasis(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.0, 1.0, 2.0]]), 2)
    with pytest.raises(eplat.EplatError):
        eplat.eigenbasis(([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, -2]]), 2)


def test_nothing_is_left_of_a_run_that_failed(tmp_path, monkeypatch):
    import tempfile

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(eplat.EplatError):
        eplat.run("erp", "embedded", tmp_path / "none.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_a_run(tmp_path):
    with pytest.raises(eplat.UsageError, match="no run.json"):
        eplat.Result(tmp_path)
    with pytest.raises(eplat.UsageError, match="holds no run of eplat.run"):
        eplat.resume(tmp_path)


#: Ctrl-C reaches Python while it runs, once sampling has begun; what is kept goes on to the same numbers.
SCRIPT = """
import os, signal, sys, threading
import eplat

def interrupt(event):
    if event["event"] == "progress" and not sent:
        sent.append(True)
        os.kill(os.getpid(), signal.SIGINT)

sent = []
try:
    eplat.run("erp", out=sys.argv[1], progress=interrupt, chains=2, warmup=1500, draws=3000)
except eplat.Interrupted as error:
    print(error)
    print(error.path)
else:
    sys.exit("the run was not interrupted")
"""


def test_an_interrupt_leaves_a_run_that_can_be_gone_on_with(tmp_path, monkeypatch):
    settings = dict(chains=2, warmup=1500, draws=3000)
    whole = eplat.run("erp", out=tmp_path / "whole", **settings)
    out = tmp_path / "cut"
    said = subprocess.run([sys.executable, "-c", SCRIPT, out], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert said.stdout.splitlines()[0] == f"interrupted: the run is kept; go on with eplat.resume({str(out)!r})"
    assert Path(said.stdout.splitlines()[1]) == out
    assert (out / "checkpoint").is_dir() and not (out / "run.json").exists()
    told = []
    monkeypatch.chdir(tmp_path)
    result = eplat.resume("cut", progress=told.append)
    assert "resumed" in [event["event"] for event in told]
    assert draws(result.path) == draws(whole.path)
    # and what is complete is only read
    assert draws(eplat.resume(out).path) == draws(whole.path)
    assert draws(eplat.run("erp", out=out, resume=True, **settings).path) == draws(whole.path)


def test_a_second_interrupt_ends_the_program_at_once(tmp_path, monkeypatch):
    import eplat.program

    listen, children = eplat.program._listen, []

    def interrupted(child, *more):
        children.append(child)
        if len(children) == 2:  # while the program keeps its run
            raise KeyboardInterrupt
        listen(child, *more)

    def interrupt(event):
        if event["event"] == "sampling":
            raise KeyboardInterrupt

    monkeypatch.setattr(eplat.program, "_listen", interrupted)
    with pytest.raises(eplat.Interrupted):
        eplat.run("erp", out=tmp_path / "out", progress=interrupt, warmup=100_000)
    assert children[0] is children[1] and children[0].returncode is not None


def test_what_a_function_of_progress_raises_ends_the_run(tmp_path):
    def fail(event):
        raise KeyError(event["event"])

    with pytest.raises(KeyError, match="surface"):
        eplat.run("erp", out=tmp_path / "out", progress=fail, **SMALL)
    assert not (tmp_path / "out/run.json").exists()


def test_a_crash_of_the_program_is_an_exception(tmp_path):
    import os
    import signal

    import eplat.program

    children = []
    start = eplat.program.subprocess.Popen

    def remembered(*arguments, **more):
        children.append(start(*arguments, **more))
        return children[-1]

    def kill(event):
        if event["event"] == "sampling":
            os.kill(children[0].pid, signal.SIGKILL)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(eplat.program.subprocess, "Popen", remembered)
        with pytest.raises(eplat.CrashError, match="ended by signal 9"):
            eplat.run("erp", out=tmp_path / "out", progress=kill, warmup=20000)
