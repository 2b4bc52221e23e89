"""How far a run is: one line that is written over, in a terminal or a notebook."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from typing import Any

from .program import Event

#: The line is written over no more often, s.
SECONDS = 0.2


class Line:
    """Shows events of the program as one line on stderr."""

    def __init__(self) -> None:
        self._chains: dict[int, int] = {}
        self._of = 0
        self._what = ""
        self._begun = time.monotonic()
        self._width = 0
        self._shown = -math.inf

    def __call__(self, event: Event) -> None:
        """Shows an event, if it tells how far the run is."""
        kind = event["event"]
        if kind == "sampling":
            self._chains, self._begun = {}, time.monotonic()
            self._of = event["chains"] * (event["warmup"] + event["draws"])
        elif kind == "progress":
            self._chains[event["chain"]] = event["done"]
            done = sum(self._chains.values())
            self._show(f"{self._what}{event['phase']}", done, self._of)
            if done == self._of:
                self._write("sampled: now maps, predictions and files")
        elif kind == "search":
            if event["done"] <= 1:
                self._begun = time.monotonic()
            self._show(f"search round {event['round']}", event["done"], event["of"])
        elif kind == "sample":
            self._what = f"model {event['which']}: "
        elif kind in ("compiling", "building_library"):
            self._write(event["text"])

    def _show(self, what: str, done: int, of: int) -> None:
        now = time.monotonic()
        if now < self._shown + SECONDS and done < of:
            return
        self._shown = now
        share = done / of if of else 0.0
        spent = now - self._begun
        left = f", {spent * (1 / share - 1):.0f} s left" if 0 < share < 1 else ""
        bar = "━" * round(24 * share)
        self._write(f"{what:<24} {bar:<24} {100 * share:3.0f} %{left}")

    def _write(self, text: str) -> None:
        print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
        self._width = len(text)

    def end(self) -> None:
        """Leaves the line."""
        if self._width:
            print(file=sys.stderr, flush=True)


def shown(progress: Any) -> Callable[[Event], None]:
    """What is told of events: `progress` itself, a line, or nobody.

    `None` means a line where a person reads it: on a terminal or in a notebook.
    """
    if callable(progress):
        told: Callable[[Event], None] = progress
        return told
    if progress is None:
        progress = sys.stderr.isatty() or _is_notebook()
    return Line() if progress else _nobody


def counted(progress: Any, what: str) -> Callable[[int, int], None] | None:
    """The same for work in this process, which tells how much of how much is done."""
    if callable(progress):
        return lambda done, of: progress({"event": what, "done": done, "of": of})
    show = shown(progress)
    return (lambda done, of: show._show(what, done, of)) if isinstance(show, Line) else None


def _nobody(_: Event) -> None:
    pass


def _is_notebook() -> bool:
    # IPython is loaded wherever there is a notebook; it need not be there
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and hasattr(shell, "kernel")
