"""The page on the paper's statements, from the program (python -m tests.rigctl.paper.statements_page)."""

import sys

from rigctl.jobs.paper import SHIPPED, PaperRequest, check_paper
from rigctl.paper import statements_page


def page() -> str:
    """Return the page; some forty seconds."""
    return statements_page(check_paper(PaperRequest()).results, SHIPPED)


if __name__ == "__main__":
    sys.stdout.write(page())
