import importlib.util
import subprocess
import sys
import sysconfig
from pathlib import Path

from conftest import ROOT

import eplat


def test_the_program_is_installed_and_of_the_same_version():
    script = Path(sysconfig.get_path("scripts")) / "eplat"
    for command in ([script], [sys.executable, "-m", "eplat"]):
        said = subprocess.run([*command, "--version"], capture_output=True, text=True)
        assert said.stdout == f"eplat {eplat.__version__}\n", said.stderr


def test_its_exit_code_is_that_of_the_program(tmp_path):
    said = subprocess.run(
        [sys.executable, "-m", "eplat", "run", "none.rs"], cwd=tmp_path, capture_output=True, text=True
    )
    assert said.returncode == 1 and said.stderr.startswith("error: cannot read the model file none.rs")


def test_the_models_are_those_in_the_sources():
    assert eplat.models() == sorted(file.stem for file in (ROOT / "models").glob("*.rs"))
    assert eplat.model_source("erp") == (ROOT / "models/erp.rs").read_text()


def test_what_is_tested_is_what_stands_in_the_sources():
    # `pip install .` again after a change
    for file in (ROOT / "python/eplat").glob("*.py"):
        assert (Path(eplat.__file__).parent / file.name).read_text() == file.read_text(), file.name


def test_the_package_has_types_and_every_public_name_a_docstring():
    assert (Path(eplat.__file__).parent / "py.typed").is_file()
    for name in set(eplat.__all__) - {"__version__"}:
        assert getattr(eplat, name).__doc__, name


def test_numpy_alone_is_needed_to_import_it():
    code = "import sys, eplat; print(*sorted({'arviz', 'pandas', 'pyvista', 'xarray', 'IPython'} & set(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout == "\n"
    assert importlib.util.find_spec("eplat._eplat") is not None
