"""The program that came with this package, as a child process.

A run is a process of its own: what ends it does not end Python, an interrupt reaches it as Ctrl-C does, and a model
with Rust code in it can be compiled into it.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .errors import CrashError, EplatError, UsageError

PROGRAM = Path(__file__).parent / "bin" / ("eplat.exe" if os.name == "nt" else "eplat")

Event = dict[str, Any]


@dataclass
class Ended:
    """How the program ended."""

    code: int
    """Its exit code; negative after a signal."""
    error: str | None = None
    """The text of its error."""
    words: list[str] = field(default_factory=list)
    """What it said besides events."""


def call(arguments: list[str], on_event: Callable[[Event], None], folder: str) -> tuple[Ended, BaseException | None]:
    """Runs `eplat ARGUMENTS --json` in `folder` to its end; `on_event` is called with every event.

    An interrupt is passed on, and the program is given the time to keep its run; a second one ends it at once. Whatever
    interrupted it is returned, too.
    """
    # of its own group: a terminal's Ctrl-C would else reach it beside what is passed on, and twice means at once
    child = subprocess.Popen(
        [PROGRAM, *arguments, "--json"],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
    )
    ended, interrupt = Ended(0), None
    try:
        _listen(child, ended, on_event)
    except BaseException as raised:  # an interrupt, or whatever `on_event` raises
        interrupt = raised
        _end(child, ended)
    ended.code = child.wait()
    return ended, interrupt


def _listen(child: subprocess.Popen[str], ended: Ended, on_event: Callable[[Event], None]) -> None:
    assert child.stderr is not None
    for line in child.stderr:
        event = _event(line)
        if event is None:
            ended.words.append(line.rstrip("\n"))
        elif event["event"] == "error":
            ended.error = event["text"]
        else:
            on_event(event)
    child.stderr.close()
    child.wait()


def _event(line: str) -> Event | None:
    if not line.startswith("{"):
        return None
    try:
        event = json.loads(line)
    except ValueError:
        return None
    return event if isinstance(event, dict) and "event" in event else None


def _end(child: subprocess.Popen[str], ended: Ended) -> None:
    _stop(child)
    try:
        _listen(child, ended, lambda _: None)
    except KeyboardInterrupt:
        _stop(child, at_once=True)


def _stop(child: subprocess.Popen[str], at_once: bool = False) -> None:
    """The program, and what it has started, such as a compiler."""
    if os.name != "posix":
        child.kill() if at_once else child.terminate()
    elif child.poll() is None:
        with contextlib.suppress(ProcessLookupError):  # it may just have ended
            os.killpg(child.pid, signal.SIGKILL if at_once else signal.SIGINT)


def failure(ended: Ended) -> EplatError:
    """The exception for a call that failed, with the program's text."""
    text = ended.error or "\n".join(ended.words)
    if ended.code < 0:
        text = f"the program was ended by signal {-ended.code}\n{text}".rstrip()
        return CrashError(text)
    text = text.removeprefix("error: ") or f"the program ended with exit code {ended.code}"
    return {1: EplatError, 2: UsageError}.get(ended.code, CrashError)(text)
