"""`python -m surefoot`, and what the command `surefoot` runs."""

import os
import sys

# One thread per process, before NumPy and PyTorch are loaded: the work is spread over processes,
# and bits may depend on the number of threads.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"


def main() -> int:
    """Run the command line."""
    try:
        from surefoot.cli.main import main as command_line
    except KeyboardInterrupt:  # loading takes a second or two
        return 130
    return command_line()


if __name__ == "__main__":
    sys.exit(main())
