"""What can go wrong. The texts are those of the program: what, where, what was expected, and what to do."""

from __future__ import annotations

from pathlib import Path


class EplatError(Exception):
    """Bad input, or a failure (exit code 1 of the program)."""


class UsageError(EplatError, ValueError):
    """Settings that make no sense (exit code 2)."""


class CrashError(EplatError, RuntimeError):
    """The program ended without saying why, for instance for want of memory. Python lives on."""


class Interrupted(KeyboardInterrupt):
    """A run that was interrupted. `eplat.resume(error.path)` goes on with it."""

    def __init__(self, text: str, path: Path) -> None:
        super().__init__(text)
        self.path = path
        """The folder in which the run is kept."""


class VerdictWarning(UserWarning):
    """A result that is there, but is not to be relied on: a red answer of the verdict, or something lost on the way."""
