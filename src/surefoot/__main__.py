"""`python -m surefoot`, and what the command `surefoot` runs."""

import os
import sys

from surefoot.workers import ONE_THREAD

os.environ.update(ONE_THREAD)


def main() -> int:
    """Run the command line; returns its exit status."""
    try:
        from surefoot.cli.main import main as command_line
    except KeyboardInterrupt:  # loading takes a second or two
        return 130
    return command_line()


if __name__ == "__main__":
    sys.exit(main())
