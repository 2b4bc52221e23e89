"""Builds the wheel: maturin's backend, with the program put into the package first.

maturin packs a module or a program, not both. Everything below the two is compiled once: their dependencies have the
same features (Cargo.toml says which are there for this alone).
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import maturin
from maturin import (  # noqa: F401  (the hooks that need nothing of ours)
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

ROOT = Path(__file__).parents[2]
PACKAGED = ROOT / "python" / "eplat" / "bin"


def _program():
    """The built program's path."""
    command = ["cargo", "build", "--release", "--locked", "--package", "eplat", "--bin", "eplat"]
    command += ["--message-format", "json-render-diagnostics"]
    built = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if built.returncode:
        raise SystemExit(f"cargo could not build eplat (exit code {built.returncode}): its message stands above")
    messages = map(json.loads, built.stdout.splitlines())
    programs = [m["executable"] for m in messages if m.get("executable")]
    return Path(next(p for p in programs if Path(p).stem == "eplat"))


def _pack():
    program = _program()
    PACKAGED.mkdir(exist_ok=True)
    packed = PACKAGED / program.name
    shutil.copy(program, packed)
    strip = shutil.which("strip") if os.name == "posix" else None
    if strip:  # symbols are of no use there
        subprocess.run([strip, packed], check=False)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    _pack()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    _pack()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)
