"""Pages of the reference that are made from the code when the site is built; none of them is kept in the repository.

Each function below returns one page as Markdown, from the source that the program itself uses: the models that check
files, the table of a scene's numbers, the cards of a frame, the exit codes, the messages of flags and checks, the
materials, the statements of the paper.
"""

import ast
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType, NoneType
from typing import Any, Literal, cast, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from model.atmosphere import aerosols, layers
from model.effects.planner import EFFECTS
from model.surface.materials import MATERIALS, Property, properties
from rigctl import console
from rigctl.archive.index import COLUMNS
from rigctl.cli import commands_page
from rigctl.comparison.checks import AGREES, VerdictName
from rigctl.files.materials import MaterialFile
from rigctl.files.regions import RegionsFile
from rigctl.files.rig_file import RigFile
from rigctl.files.scene_file import SceneFile
from rigctl.files.session_file import InterlockSection, SessionFile
from rigctl.files.study_file import StudyFile
from rigctl.files.toml import Uncertain, key_texts, unit_of
from rigctl.paper.statements import IN_WORDS, Judged, descriptions, statements
from rigctl.runs.fits import _KEYWORDS
from rigctl.runs.records import FrameRecord
from rigctl.scene.scene import describe
from rigctl.verbs.paper import SHIPPED, PaperResult, paper

_ROOT = Path(__file__).parents[1]
_FILES: tuple[tuple[str, type[BaseModel]], ...] = (
    ("Rig file", RigFile),
    ("Session file", SessionFile),
    ("Scene file", SceneFile),
    ("Regions file", RegionsFile),
    ("Material file", MaterialFile),
    ("Study file", StudyFile),
)
_KEYS_HEAD = """# Keys of files

All files that you write are TOML. A number marked "uncertain" can be written as `1.2`, as `{ value = 1.2, std = 0.1
}` or as `{ range = [1.0, 1.4] }`. `[[name]]` is a table that may occur several times; its keys follow it. An unknown
key is refused, with the nearest known one. [Parameters](parameters.md) lists the numbers of a scene under the names
that they have in sweeps and reports.
"""


def write_pages(folder: Path) -> None:
    """Write all pages into a folder, each only where it changed."""
    for name, page in PAGES.items():
        text, path = page(), folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


@dataclass(frozen=True, kw_only=True)
class Key:
    """A key of a file that people write: one row of the page."""

    shown: str  #: With the tables that contain it; in brackets if it is a table itself.
    field: FieldInfo  #: Of the model that checks it.
    is_table: bool  #: Its own keys follow it.
    meaning: str  #: One line; empty if the model has none.
    example: str  #: A value as TOML has it; empty for a table.

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells of its row."""
        uncertain = ", uncertain" if not self.is_table and Uncertain in _models(self.field.annotation) else ""
        many = "tables" if self.shown.startswith("[[") else "table"
        kind = many if self.is_table else _kind(self.field.annotation) + uncertain
        unit = unit_of(self.shown)
        example = f"`{self.example}`" if self.example else ""
        return (f"`{self.shown}`", self.meaning, example, kind, unit, _limits(self.field), _default(self.field))


def keys_page() -> str:
    """Return the page of all keys: a table for each kind of file."""
    parts = [_KEYS_HEAD]
    for title, keys in file_keys():
        parts.append(f"\n## {title}\n\n| key | meaning | example | type | unit | allowed | default |\n")
        parts.append("|---|---|---|---|---|---|---|\n")
        parts += [f"| {' | '.join(key.cells)} |\n" for key in keys]
    return "".join(parts)


def file_keys() -> Iterator[tuple[str, tuple[Key, ...]]]:
    """Yield each kind of file with all its keys."""
    for title, model in _FILES:
        yield title, tuple(_keys(model, ""))


def _keys(model: type[BaseModel], place: str) -> Iterator[Key]:
    texts = key_texts(model)
    for name, field in model.model_fields.items():
        key = place + (field.alias or name)
        meaning, example = texts.get(name, ("", ""))
        inner = [one for one in _models(field.annotation) if one is not Uncertain]
        if not inner:
            yield Key(shown=key, field=field, is_table=False, meaning=meaning, example=example)
            continue
        shown = f"[[{key}]]" if "list" in _kind(field.annotation) else f"[{key}]"
        yield Key(shown=shown, field=field, is_table=True, meaning=meaning, example=example)
        for one in dict.fromkeys(inner):
            yield from _keys(one, f"{key}.")


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def _kind(annotation: Any) -> str:
    """Return the type of a value in words."""
    if get_origin(annotation) is Literal:
        return " or ".join(f"`{word}`" for word in get_args(annotation))
    if isinstance(annotation, type) and issubclass(annotation, StrEnum):
        return " or ".join(f"`{word}`" for word in annotation)
    inner = [one for one in get_args(annotation) if one is not NoneType and one is not Ellipsis]
    origin = get_origin(annotation)
    if origin in (list, tuple):
        return f"list of {_kind(inner[0])}"
    if origin is dict:
        return "table"
    if hasattr(annotation, "__metadata__"):
        return _kind(inner[0])
    if inner:
        return " or ".join(dict.fromkeys(_kind(one) for one in inner))
    names = {float: "number", int: "whole number", str: "text", bool: "true or false", Uncertain: "number"}
    name = getattr(annotation, "__name__", str(annotation)).lower()
    return names.get(annotation, "time with its zone" if name in ("awaredatetime", "datetime") else name)


def _limits(field: FieldInfo) -> str:
    """Return the range in words; of a list, how many it needs and the range of each."""
    signs = {"ge": "from", "gt": "above", "le": "to", "lt": "below", "min_length": "at least"}
    words: list[str] = []
    for one in (*field.metadata, *_annotations(field.annotation)):
        found = [(sign, getattr(one, name, None)) for name, sign in signs.items()]
        words += [f"{sign} {limit:.12g}" for sign, limit in found if isinstance(limit, int | float)]
    return ", ".join(dict.fromkeys(words))


def _annotations(annotation: Any) -> Iterator[Any]:
    """Yield the annotated limits of the values inside, such as those of a list."""
    for one in getattr(annotation, "__metadata__", ()):
        yield from one.metadata if isinstance(one, FieldInfo) else (one,)
    if not isinstance(annotation, type) and get_origin(annotation) is not Literal:
        for inner in get_args(annotation):
            yield from _annotations(inner)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    if field.default is None or field.default is PydanticUndefined or isinstance(field.default, BaseModel):
        value = getattr(field.default, "value", None)
        return f"`{value:g}`" if isinstance(value, int | float) else ""
    if isinstance(field.default, bool):
        return f"`{str(field.default).lower()}`"
    if isinstance(field.default, tuple):
        return f"`{list(field.default)}`".replace("'", '"')
    return f"`{field.default}`"


def parameters_page() -> str:
    """Return the page of the numbers of a scene."""
    head = (
        "# Parameters of a scene\n\nEvery number of a scene by its key, as `--set`, `rigctl sweep` and reports use it. "
        "NAME is the name of a region, ANGLE a polarizer angle in degrees.\n\n"
        "| key | unit | range | meaning |\n|---|---|---|---|\n"
    )
    rows = (
        f"| `{row.key}` | {row.unit or '1'} | {_range(row.least, row.most)} | {row.meaning} |" for row in describe()
    )
    return head + "\n".join(rows) + "\n"


def _range(least: float, most: float) -> str:
    if math.isinf(least) and math.isinf(most):
        return "any"
    return f"from {least:g}" if math.isinf(most) else f"{least:g} to {most:g}"


def frames_page() -> str:
    """Return the page of the fields of a frame, as FITS cards and in the manifest."""
    rows = [f"| `{keyword}` | `{field}` | {_cell(comment)} |" for field, keyword, comment in _KEYWORDS]
    with_card = {field for field, _, _ in _KEYWORDS}
    rows += [f"| | `{one.name}` | {_NO_CARD[one.name]} |" for one in fields(FrameRecord) if one.name not in with_card]
    return _FRAMES_HEAD + "\n".join(rows) + "\n"


_FRAMES_HEAD = """# Frames

Each frame of a run is one FITS file. Its header has the cards below; the same values are in `manifest.jsonl` under the
name of the field, in HDF5 under `frames/`, and in the attribute `frames` of a Zarr group, one value per frame. The
counts are called `counts` there, in the order (frame, y, x), as unsigned 16 bit numbers; `session` holds the content of
`session.json` and `records` (HDF5) the record of each frame as JSON.

`ROWORDER` is always `TOP-DOWN` (the first row is the top of the picture), `TIMESYS` is UTC, `SWVER` is the program,
`DATASUM` and `CHECKSUM` are the sums that the FITS standard defines.

| card | field | meaning |
|---|---|---|
"""
_NO_CARD = {
    "file": "name in the run folder",
    "checksum": "SHA-256 of the file",
    "width": "width of the picture, in pixels",
    "height": "height of the picture, in pixels",
    "remarks": "notes on the frame; in the header as `REMARK1`, `REMARK2`, ...",
}


def columns_page() -> str:
    """Return the page of the columns that an archive can be searched by."""
    rows = (f"| `{one.name}` | {one.kind} | {one.level} | {one.meaning} |" for one in COLUMNS)
    return _COLUMNS_HEAD + "\n".join(rows) + "\n"


_COLUMNS_HEAD = """# Columns of an archive

`rigctl archive find` compares these columns with numbers or texts ([how](how-to/archives.md)). Columns of a comparison
or a region exist once the run has been compared.

| column | kind | belongs to the | meaning |
|---|---|---|---|
"""


_EXIT_MEANINGS = {
    console.EXIT_USAGE: "usage, or a file that people write",
    console.EXIT_DEVICE: "a device",
    console.EXIT_DATA: "unfit data: refused, damaged, wrong checksum; a comparison that cannot be judged",
    console.EXIT_DISAGREES: "model and measurement disagree",
    console.EXIT_OWN_FAULT: "a fault of rigctl itself: one line, and a log with the traceback",
    console.EXIT_INCOMPLETE: "a session stopped on request or by Ctrl-C, to be resumed; `verify`: an unfinished run",
    console.EXIT_INTERRUPTED: "interrupted; in `acquire` and `resume` by a second Ctrl-C",
}
_VERDICT_STEPS = {
    "agrees": "nothing; the report states the smallest difference it could have seen",
    "agrees_with_reservations": "read the reservations: a check of the run is flagged",
    "disagrees": "read the causes that would explain the residuals, then the checks of the run",
    "cannot_be_judged": "take the run again as the refused check says, or correct what it shows (`--correct`)",
}


def codes_page() -> str:
    """Return the page of exit codes, verdicts, interlocks, flags, checks and effects."""
    parts = (_exit_codes(), _verdicts(), _interlocks(), _flags(), _checks(), _effects())
    return "# Codes, interlocks, flags, checks, effects\n" + "".join(parts)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")


def _exit_codes() -> str:
    text = "\n## Exit codes\n\n| code | meaning | what to do |\n|---|---|---|\n"
    text += "| 0 | done; model and measurement agree, perhaps with stated reservations | |\n"
    for code, meaning in sorted(_EXIT_MEANINGS.items()):
        step = str(console.failure_content(code, "", verb="VERB")["error"]["next"])
        text += f"| {code} | {meaning} | {step} |\n"
    return (
        f'{text}\nWith `--json` a failure prints `{{"error": {{"code", "kind", "message", "key", "next"}}}}` to '
        "standard output; the exit code is the same, and `key` is the first key or option that the message names.\n"
    )


def _verdicts() -> str:
    text = "\n## Verdicts of a comparison\n\n"
    text += "| verdict | `agrees` | what to do |\n|---|---|---|\n"
    for name in get_args(VerdictName):
        agrees = {True: "true", False: "false", None: "null"}[AGREES[name]]
        text += f"| `{name}` | {agrees} | {_VERDICT_STEPS[name]} |\n"
    return text


def _interlocks() -> str:
    text = (
        "\n## Interlocks\n\n[Rooftop sessions](rooftop.md#interlocks) says what trips each of them and what happens."
        "\n\n| key of `[interlocks]` | default | other values |\n|---|---|---|\n"
    )
    for name, field in InterlockSection.model_fields.items():
        choices = [choice for choice in get_args(field.annotation) if choice != field.default]
        others = ", ".join(f"`{choice}`" for choice in choices if isinstance(choice, str))
        text += f"| `{name}` | `{field.default}` | {others or 'a number'} |\n"
    return text


def _flags() -> str:
    """Return names and messages of all flags, as the source has them."""
    text = (
        "\n## Flags of a calibration\n\nFlags are listed under `flags` in `noise.json` and in the report. `...` stands "
        "for a number or a name. A flag that refuses leaves no result."
        "\n\n| flag | message, and what to do |\n|---|---|\n"
    )
    found: dict[str, list[str]] = {}
    for path in sorted((_ROOT / "calibration").rglob("*.py")):
        for name, message in (*_messages(path), *(one for function in _functions(path) for one in _flags_of(function))):
            if message not in found.setdefault(name, []):
                found[name].append(message)
    return text + "".join(f"| `{name}` | {'<br>'.join(found[name])} |\n" for name in sorted(found))


def _functions(path: Path) -> Iterator[ast.FunctionDef]:
    yield from (one for one in ast.walk(ast.parse(path.read_text())) if isinstance(one, ast.FunctionDef))


def _messages(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the flags and messages of a module's table `_MESSAGES`."""
    source = path.read_text()
    for one in ast.parse(source).body:
        if isinstance(one, ast.Assign) and ast.unparse(one.targets[0]) == "_MESSAGES":
            for name, text in ast.literal_eval(one.value).items():
                refuses = "; refuses" if f'"{name}", refuses=True' in source else ""
                yield name, _cell(re.sub(r"{[^}]+}", "...", text)) + refuses


def _flags_of(function: ast.FunctionDef) -> Iterator[tuple[str, str]]:
    assigned = {ast.unparse(one.targets[0]): one.value for one in ast.walk(function) if isinstance(one, ast.Assign)}
    for call in ast.walk(function):
        if not (isinstance(call, ast.Call) and getattr(call.func, "id", "") == "Flag"):
            continue
        given = {one.arg: one.value for one in call.keywords}
        message = assigned.get(ast.unparse(given["message"]), given["message"])
        refuses = "; refuses" if isinstance(given.get("refuses"), ast.Constant) else ""
        name, is_in_table = _template(given["name"]), "_MESSAGES[" in ast.unparse(message)
        if name != "..." and not is_in_table:
            yield name, _cell(_template(message)) + refuses


def _template(node: ast.expr | None) -> str:
    """Return the text of an expression, with three dots for each value that is put in."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(_template(part) for part in node.values)
    if isinstance(node, ast.BinOp):
        return _template(node.left) + _template(node.right)
    if isinstance(node, ast.IfExp):
        return _template(node.body)
    return "..."


def _checks() -> str:
    text = "\n## Checks of a run\n\nEach check is sound, flagged, refused or not testable, and gives its reason.\n\n"
    text += "| check | message, and what to do |\n|---|---|\n"
    found: dict[str, str] = {}
    for function in _functions(_ROOT / "rigctl" / "comparison" / "checks.py"):
        assigned: dict[str, ast.expr] = {}
        for one in ast.walk(function):
            if isinstance(one, ast.Assign):
                target, value = one.targets[0], one.value
                pairs = (
                    zip(target.elts, value.elts, strict=True)
                    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
                    else [(target, value)]
                )
                assigned |= {ast.unparse(name): given for name, given in pairs}
        for call in ast.walk(function):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "Check":
                given = {one.arg: one.value for one in call.keywords}
                name = _template(assigned.get(ast.unparse(given["name"]), given["name"])).removesuffix(" of ...")
                message = _cell(_template(assigned.get(ast.unparse(given["text"]), given["text"])))
                found[name] = max(found.get(name, ""), message, key=len)
    return text + "".join(f"| {name} | {message} |\n" for name, message in found.items())


def _effects() -> str:
    text = (
        "\n## Effects\n\nNames for `--with`, `--without` and `[effects]` of a scene file. [How the program decides "
        "which of them matter](effects.md).\n\n| effect | key | changes | costs |\n|---|---|---|---|\n"
    )
    for name, effect in EFFECTS.items():
        text += f"| {name.value} | `{name.value.replace(' ', '-')}` | {effect.changes} | {effect.cost} |\n"
    return text


def materials_page() -> str:
    """Return the page of materials and aerosols with their sources."""
    text = (
        '# Materials and aerosols\n\nA value marked "assumed" was not measured on such a surface; replace it by your '
        "own measurement ([a material of your own](how-to/material.md)).\n"
    )
    for key, material in MATERIALS.items():
        text += f"\n## `{key}`\n\n| property | value | std | basis | confidence | source |\n|---|---|---|---|---|---|\n"
        for name, found in properties(material).items():
            basis = "assumed" if found.assumed else "measured"
            cells = [name, _values(found), f"{found.standard_uncertainty:g}", basis]
            text += f"| {' | '.join([*cells, found.confidence, _cell(found.source)])} |\n"
    text += (
        "\n## Aerosols\n\n`atmosphere.aerosol_type` selects the particles. Rural and tropospheric are those of Shettle "
        "& Fenn, AFGL-TR-79-0214 (1979), as tabulated in LOWTRAN 7 (Kneizys et al., AFGL-TR-88-0177). The others are "
        "spheres with the sizes and indices given here; `[atmosphere.own_aerosol]` describes your own."
        "\n\n| type | particles |\n|---|---|\n"
    )
    text += "".join(f"| `{name}` | {meaning} |\n" for name, meaning in _enum(aerosols, aerosols.AerosolType))
    text += (
        "\n`atmosphere.aerosol` says how they polarize, which is [the largest uncertainty of the sky](atmosphere.md)."
        "\n\n| kind | meaning |\n|---|---|\n"
    )
    return text + "".join(f"| `{name}` | {meaning} |\n" for name, meaning in _enum(layers, layers.AerosolKind))


def _values(found: Property) -> str:
    if len(found.values) == 1:
        return f"{found.values[0]:g}"
    first_nm, last_nm = found.wavelengths_m[0] * 1e9, found.wavelengths_m[-1] * 1e9
    return f"{found.values[0]:g} to {found.values[-1]:g} at {first_nm:g} to {last_nm:g} nm"


def _enum(module: Any, kind: type[StrEnum]) -> Iterator[tuple[str, str]]:
    """Yield the values of an enumeration with the texts below them in the source."""
    tree = ast.parse(Path(module.__file__).read_text())
    body = next(one for one in ast.walk(tree) if isinstance(one, ast.ClassDef) and one.name == kind.__name__).body
    for one, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(one, ast.Assign):
            is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            yield ast.literal_eval(one.value), " ".join(str(after.value.value).split()) if is_text else ""


_STATEMENTS_HEAD = """# Statements of [MK14], with verdicts

Every sentence of sections II-C to VI that claims something about a figure, checked by `rigctl paper` while this page
was built. The paper takes the optical properties of its materials from a reference that is not at hand, so two sets of
materials are used:

- **library**: black paint (slope 0.15) and asphalt (slope 0.30) of the material library, with a texture that multiplies
  all Stokes parameters of the asphalt by the same factor (`examples/paper/library.toml`);
- **rough**: paint of slope 0.30, asphalt of slope 0.40, and the independent texture of eq. (10), 5 % of the reflected
  S0 in S0, S1 and S2 each (`examples/paper/rough.toml`). Nothing else was adjusted.

[The paper and rigctl](paper.md) explains the verdicts and what decides them.

"""


def statements_page() -> str:
    """Return the page of the paper's statements; computing the verdicts takes some forty seconds."""
    found = cast("PaperResult", paper())
    by_key = {(one.materials, one.statement.id): one for one in found.found.results}
    rows = ["| figure | id | sentence | where | check | " + " | ".join(SHIPPED) + " |\n" + "|---" * (5 + len(SHIPPED))]
    for one in statements():
        cells = [verdict_cell(by_key[name, one.id]) for name in SHIPPED]
        rows.append(
            f"| {one.figure} | {one.id} | {one.sentence} | {one.geometry} | {one.check} | {' | '.join(cells)} |"
        )
    rows.append(
        "\n## Sentences that describe a figure\n\nThese sentences claim nothing that could hold or fail.\n\n"
        "| figure | sentence | here |\n|---|---|---|"
    )
    rows += [f"| {figure} | {sentence} | {here} |" for figure, sentence, here in descriptions()]
    return _STATEMENTS_HEAD + "\n".join(rows) + "\n"


def verdict_cell(one: Judged) -> str:
    """Return verdict and deciding numbers of a statement, as a cell of the page."""
    text = IN_WORDS[one.verdict]
    if len({reading.verdict for reading in one.readings}) > 1:
        text += ": " + "; ".join(f"{reading.name}: {IN_WORDS[reading.verdict]}" for reading in one.readings)
    test = one.readings[0].deciding
    numbers = ", ".join(f"{number.label} {number.value:.3g}" for number in (() if test is None else test.numbers[:2]))
    return f"**{text}**. {numbers}".rstrip(". ") if numbers else f"**{text}**"


PAGES: Mapping[str, Callable[[], str]] = MappingProxyType(
    {
        "commands.md": commands_page,
        "archive-columns.md": columns_page,
        "file-keys.md": keys_page,
        "frames.md": frames_page,
        "parameters.md": parameters_page,
        "codes.md": codes_page,
        "materials.md": materials_page,
        "paper-statements.md": statements_page,
    }
)
