"""The entry point of `python -m surefoot` and of the command `surefoot`.

It sets the number of threads before NumPy and PyTorch are loaded. Read `cli.main` next.
"""

import os
import sys

from surefoot.workers import ONE_THREAD

os.environ.update(ONE_THREAD)


def main() -> int:
    """Run the command line, and return its exit status."""
    try:
        from surefoot.cli.main import main as command_line
    except KeyboardInterrupt:  # loading takes a second or two
        return 130
    return command_line()


if __name__ == "__main__":
    sys.exit(main())
