"""`eplat` and `python -m eplat`: the program that came with this package."""

import os
import subprocess
import sys

from .program import PROGRAM


def main() -> None:
    """Becomes the program, with the arguments of this process."""
    command = [str(PROGRAM), *sys.argv[1:]]
    if os.name == "posix":
        os.execv(PROGRAM, command)
    sys.exit(subprocess.run(command).returncode)


if __name__ == "__main__":
    main()
