"""Models by name, path or source text."""

from __future__ import annotations

import difflib
import hashlib
import os
import re
import tempfile
from pathlib import Path

from . import _eplat
from .errors import EplatError, UsageError


def models() -> list[str]:
    """Names of the models that ship."""
    return sorted(_eplat.shipped_models())


def model_source(name: str) -> str:
    """Text of a model that ships, to start from."""
    shipped = _eplat.shipped_models()
    if name not in shipped:
        raise UsageError(f"no model {name!r} ships with eplat{_near(name, shipped)}")
    return shipped[name]


def model_file(model: str | os.PathLike[str]) -> Path:
    """The file of a model that is given by name, path or source text.

    A text is kept in the cache folder under its hash, so that one with Rust code in it is compiled once.
    """
    text = os.fspath(model)
    if "model!" in text:
        return _kept(_name_of(text), text)
    if isinstance(model, os.PathLike) or text.endswith(".rs"):
        return Path(text)
    shipped = _eplat.shipped_models()
    if text in shipped:
        return _kept(text, shipped[text])
    raise UsageError(
        f"no model {text!r}: expected the name of a model that ships, a path that ends in .rs, or a text with `model!`"
        + _near(text, shipped)
    )


def _near(name: str, known: dict[str, str]) -> str:
    near = difflib.get_close_matches(name, known, n=3) or sorted(known)
    return "\nhelp: there is " + ", ".join(near)


def _name_of(text: str) -> str:
    found = re.search(r"\bmodel\s+(\w+)\s*;", text)
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", found[1]).lower() if found else "model"


def _kept(name: str, text: str) -> Path:
    cache = _eplat.cache_folder()
    base = Path(cache) if cache else Path(tempfile.gettempdir()) / "eplat"
    folder = base / "python" / hashlib.sha256(text.encode()).hexdigest()[:16]
    file = folder / f"{name}.rs"
    try:
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            folder.mkdir(parents=True, exist_ok=True)
            unfinished = file.with_suffix(f".{os.getpid()}")
            unfinished.write_text(text, encoding="utf-8")
            unfinished.replace(file)
    except OSError as error:
        raise EplatError(f"cannot write {file}: {error}\nhelp: set EPLAT_CACHE to a writable folder") from error
    return file
