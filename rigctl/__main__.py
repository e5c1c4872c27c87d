"""The program's entry: ``rigctl`` and ``python -m rigctl``."""

import sys

from rigctl import cli


def main() -> None:
    """Run the command line of this process and leave with its exit code."""
    sys.exit(cli.main())


if __name__ == "__main__":
    main()
