"""Code blocks of the pages: what stands in them, and whether commands and their options are those of the program.

A comment before a block says why it does not run, or how: ``<!-- hardware -->`` (it needs a device), ``<!-- browser
-->`` (a person at a browser), ``<!-- shown: WHY -->`` (it is not for running), ``<!-- elsewhere: WHERE -->`` (another
part of CI runs it), ``<!-- file: NAME -->`` (what the reader writes into that file), ``<!-- exit N -->`` (with what
its last command ends).
"""

import re
import shlex
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cyclopts import CycloptsError
from markdown_it import MarkdownIt

from docs.reference_pages import PAGES
from rigctl import cli

ROOT = Path(__file__).parents[2]
NOT_RUN = ("hardware", "browser", "shown", "elsewhere")
LANGUAGES = ("sh", "toml", "python", "text", "mermaid")
_MARK = re.compile(r"<!-- (hardware|browser|shown|elsewhere|file|exit \d+)(?:: ([^>]*))? -->")


@dataclass(frozen=True, kw_only=True)
class Block:
    """One block of code of a page."""

    page: Path
    line: int
    language: str
    text: str
    mark: str = ""
    note: str = ""

    @property
    def place(self) -> str:
        """File and line, as an editor takes them."""
        return f"{self.page.relative_to(ROOT) if self.page.is_relative_to(ROOT) else self.page}:{self.line}"

    @property
    def commands(self) -> list[list[str]]:
        """Commands of a shell block, as words; pages use neither pipes nor variables."""
        lines = [re.sub(r"\s#\s.*", "", line) for line in self.text.replace("\\\n", " ").splitlines()]
        return [words for line in lines for one in line.split("; ") if (words := shlex.split(one, comments=True))]


def pages() -> list[Path]:
    """Return all pages that people read, those that the build of the site makes left out."""
    found = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")]
    return sorted(
        page for page in found if not {"made", "_build"} & set(page.parts) and page.name not in ("CHANGELOG.md", *PAGES)
    )


def blocks_of(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page, from top to bottom."""
    mark, note = "", ""
    for token in MarkdownIt("commonmark").parse(page.read_text(encoding="utf-8")):
        if token.type in ("fence", "code_block"):
            language, line = token.info.strip(), (token.map or [0])[0] + 1
            if not language.startswith("{"):  # a directive of the site
                yield Block(page=page, line=line, language=language, text=token.content, mark=mark, note=note)
        found = _MARK.fullmatch(token.content.strip()) if token.type == "html_block" else None
        mark, note = (found[1], found[2] or "") if found else ("", "")


def problem_of(block: Block) -> str | None:
    """Return what is wrong with a block; None where nothing is."""
    if block.language not in LANGUAGES and (
        block.language or re.search(r"^(rigctl|import) ", block.text, re.MULTILINE)
    ):
        return f"is {block.language or 'indented'!r}; a block is fenced, and one of {', '.join(LANGUAGES)}"
    if block.mark in ("shown", "elsewhere") and not block.note:
        return f"the mark {block.mark} says why: <!-- {block.mark}: ... -->"
    try:
        if block.language == "toml":
            tomllib.loads(block.text)
        elif block.language == "python":
            compile(block.text, block.place, "exec")
        elif block.language == "sh":
            for words in block.commands:
                _check_command(words)
    except (ValueError, SyntaxError, CycloptsError) as error:
        return str(error)
    except Exception as error:
        if not hasattr(error, "format_message"):
            raise
        return str(error.format_message())
    return None


def _check_command(words: list[str]) -> None:
    """Raise an error where a command of ours, or a target of make, is not as it stands there."""
    program = Path(words[0]).name
    if program == "rigctl":
        cli.parsed(words[1:])
    elif program == "make":
        targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
        unknown = [word for word in words[1:] if "=" not in word and word not in targets]
        if unknown:
            raise ValueError(f"there is no target {unknown[0]}")
