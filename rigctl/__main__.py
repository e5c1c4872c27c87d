"""The program's entry: ``rigctl`` and ``python -m rigctl``."""

import os
import sys

# The matrices here are small: threads of the linear algebra library wait for each other longer than they work. It has
# to be said before numpy is imported; who has said otherwise keeps it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Models of files are checked by pydantic alone: it would look for plug-ins in the metadata of every package there is.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")

from rigctl import cli


def main() -> None:
    """Run the command line of this process and leave with its exit code."""
    sys.exit(cli.main())


if __name__ == "__main__":
    main()
