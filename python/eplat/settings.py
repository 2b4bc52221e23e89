"""Settings of Python as options of the program, checked against the options that it has."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Mapping
from typing import Any

from . import _eplat

# What has a parameter of its own here, or is no matter of Python.
_TAKEN = {"mesh", "data", "out", "heldout", "json", "quiet", "help"}
_WITHOUT_DRAWS = "optimize"


def arguments(command: str, settings: Mapping[str, Any]) -> list[str]:
    """The options of `eplat COMMAND` that `settings` stand for.

    `True` is an option without a value; `None` and `False` are left out. A dict stands for NAME=VALUE pairs.

    Raises `TypeError` for a setting that the program does not have, with those that are near.
    """
    options = {name: takes for name, takes in _eplat.options(command).items() if name not in _TAKEN}
    found: list[str] = []
    for name, value in settings.items():
        option = name.replace("_", "-")
        if option == _WITHOUT_DRAWS:
            raise TypeError(
                "optimize: a mode has no draws\n"
                "help: `eplat run MODEL --optimize` finds it; laplace=True draws around it"
            )
        if option not in options:
            raise TypeError(_unknown(command, name, options))
        found += _option(name, options[option], value)
    return found


def _unknown(command: str, name: str, options: Mapping[str, str]) -> str:
    names = [option.replace("-", "_") for option in options]
    near = difflib.get_close_matches(name, names, n=3)
    help = f"did you mean {' or '.join(near)}?" if near else "there is " + ", ".join(names)
    return f"eplat.{command}() has no setting {name!r}\nhelp: {help}"


def _option(name: str, takes: str, value: Any) -> list[str]:
    option = "--" + name.replace("_", "-")
    if value is None or value is False:
        return []
    if takes == "flag":
        if value is not True:
            raise TypeError(f"{name}: expected True or False, got {value!r}")
        return [option]
    if value is True:
        raise TypeError(f"{name}: expected a value, got True")
    values = _texts(value)
    if takes == "list":
        return [f"{option}={','.join(values)}"]
    if takes == "value" and len(values) != 1:
        raise TypeError(f"{name}: expected one value, got {value!r}")
    return [f"{option}={each}" for each in values]


def _texts(value: Any) -> list[str]:
    if isinstance(value, (str, os.PathLike)):
        return [os.fspath(value)]
    if isinstance(value, Mapping):
        return [f"{name}={each}" for name, each in value.items()]
    if isinstance(value, Iterable):
        return [str(each) for each in value]
    return [str(value)]
