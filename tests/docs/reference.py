"""Pages of the reference that are made from the code.

``python -m tests.docs.reference`` writes them; a test holds each against the code.
"""

import ast
import re
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Any, get_args

from model.atmosphere import aerosols as aerosol_models
from model.atmosphere import layers as phase
from model.effects.planner import EFFECTS
from model.surface.materials import MATERIALS, Property
from rigctl.comparison.checks import AGREES, VERDICT_WORDS, VerdictName
from rigctl.console import failures
from rigctl.files.session_file import InterlockSection
from rigctl.session.interlocks import Name
from tests.docs.blocks import ROOT

DOCS = ROOT / "docs"
_MADE = "Made from the code by `python -m tests.docs.reference`.\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")


def codes_page() -> str:
    """Return the page of exit codes, verdicts, interlocks, flags, checks, effects."""
    return "".join(
        (
            f"# Codes, interlocks, flags, checks, effects\n\n{_MADE}",
            _exit_codes(),
            _verdicts(),
            _interlocks(),
            _flags(),
            _checks(),
            _effects(),
        )
    )


_ENDS = {
    failures.EXIT_USAGE: "usage, or a file that people write",
    failures.EXIT_DEVICE: "a device",
    failures.EXIT_DATA: "data unfit: refused, damaged, a checksum that fails; a comparison that cannot be judged",
    failures.EXIT_DISAGREES: "model and measurement disagree",
    failures.EXIT_OWN_FAULT: "a fault of rigctl itself: one line, and a log with the traceback",
    failures.EXIT_INCOMPLETE: "a session stopped on request or by Ctrl-C, to be resumed; `verify`: an unfinished run",
    failures.EXIT_INTERRUPTED: "interrupted; in `acquire` and `resume` by a second Ctrl-C",
}


def _exit_codes() -> str:
    codes = sorted(
        value for name, value in vars(failures).items() if name.startswith("EXIT_") and isinstance(value, int)
    )
    text = "\n## Exit codes\n\n| code | meaning | what to do |\n|---|---|---|\n"
    text += "| 0 | done; model and measurement agree, with reservations named where there are any | |\n"
    for code in codes:
        step = str(failures.failure_content(code, "", verb="VERB")["error"]["next"])
        text += f"| {code} | {_ENDS[code]} | {step} |\n"
    return (
        f'{text}\nWith `--json` a failure prints `{{"error": {{"code", "kind", "message", "key", "next"}}}}` to '
        "standard output; the code is the same, `key` the first key or option that the message names.\n"
    )


_VERDICT_STEPS = {
    "agrees": "nothing; the report says what difference it could have seen",
    "agrees_with_reservations": "read the reservations: a check of the run is flagged",
    "disagrees": "read what would explain the residuals, then the checks of the run",
    "cannot_be_judged": "take the run again as the refused check says, or correct what it shows (`--correct`)",
}


def _verdicts() -> str:
    text = "\n## Verdicts of a comparison\n\n"
    text += "| verdict | model and measurement | `agrees` | what to do |\n|---|---|---|---|\n"
    for name in get_args(VerdictName):
        agrees = {True: "true", False: "false", None: "null"}[AGREES[name]]
        text += f"| `{name}` | {VERDICT_WORDS[name]} | {agrees} | {_VERDICT_STEPS[name]} |\n"
    return text


def _interlocks() -> str:
    text = (
        "\n## Interlocks\n\nWhat trips each, and what is done, is in [Rooftop sessions](rooftop.md#interlocks).\n\n"
        "| key of `[interlocks]` | default | or |\n|---|---|---|\n"
    )
    for name, field in InterlockSection.model_fields.items():
        choices = [choice for choice in get_args(field.annotation) if choice != field.default]
        others = ", ".join(f"`{choice}`" for choice in choices if isinstance(choice, str))
        assert bool(others) == (name in get_args(Name)), name
        text += f"| `{name}` | `{field.default}` | {others or 'a number'} |\n"
    return text


def _flags() -> str:
    """Return names and messages of all flags, as they stand in the source."""
    text = (
        "\n## Flags of a calibration\n\nUnder `flags` of `noise.json`, and in the report. `...` stands for a number or "
        "a name. A flag that refuses leaves no result.\n\n| flag | says, and what to do |\n|---|---|\n"
    )
    found: dict[str, list[str]] = {}
    for path in sorted((ROOT / "calibration").rglob("*.py")):
        for name, message in (*_messages(path), *(one for function in _functions(path) for one in _flags_of(function))):
            if message not in found.setdefault(name, []):
                found[name].append(message)
    return text + "".join(f"| `{name}` | {'<br>'.join(found[name])} |\n" for name in sorted(found))


def _functions(path: Path) -> Iterator[ast.FunctionDef]:
    yield from (one for one in ast.walk(ast.parse(path.read_text())) if isinstance(one, ast.FunctionDef))


def _messages(path: Path) -> Iterator[tuple[str, str]]:
    """Return the flags and messages of a module's table of them."""
    source = path.read_text()
    for one in ast.parse(source).body:
        if isinstance(one, ast.Assign) and ast.unparse(one.targets[0]) == "_MESSAGES":
            for name, said in ast.literal_eval(one.value).items():
                refuses = "; refuses" if f'"{name}", refuses=True' in source else ""
                yield name, _cell(re.sub(r"{[^}]+}", "...", said)) + refuses


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
            yield name, _said(message) + refuses


def _said(node: ast.expr) -> str:
    return _cell(_template(node)).replace("\\_", "_").replace("_", "\\_")


def _template(node: ast.expr | None) -> str:
    """Return the text of an expression, three dots for what is put in."""
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
    text = "\n## Checks of a run\n\nEach is sound, flagged, refused or not testable, and says why.\n\n"
    text += "| check | says, and what to do |\n|---|---|\n"
    found: dict[str, str] = {}
    for function in _functions(ROOT / "rigctl" / "comparison" / "checks.py"):
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
                said = _said(assigned.get(ast.unparse(given["text"]), given["text"]))
                found[name] = max(found.get(name, ""), said, key=len)
    return text + "".join(f"| {name} | {said} |\n" for name, said in found.items())


def _effects() -> str:
    text = (
        "\n## Effects\n\nFor `--with` and `--without`, and `[effects]` of a scene file. One that matters at the "
        "tolerance asked for is taken, the others are left out and it is said; [how that is decided](effects.md).\n\n"
        "| effect | key | changes | costs |\n|---|---|---|---|\n"
    )
    for name, effect in EFFECTS.items():
        text += f"| {name.value} | `{name.value.replace(' ', '-')}` | {effect.changes} | {effect.cost} |\n"
    return text


def materials_page() -> str:
    """Return the page of materials and aerosols with their sources."""
    text = (
        f"# Materials and aerosols\n\n{_MADE}A value that is assumed was not measured on such a surface; replace "
        "it by what you measured ([a material of your own](how-to/material.md)).\n"
    )
    for key, material in MATERIALS.items():
        text += f"\n## `{key}`\n\n| property | value | std | basis | confidence | source |\n|---|---|---|---|---|---|\n"
        for name in ("n", "k", "slope_rms", "dhr", "specular_weight"):
            found = getattr(material, name)
            if found is None:
                continue
            cells = [
                name,
                _values(found),
                f"{found.standard_uncertainty:g}",
                "assumed" if found.assumed else "measured",
            ]
            text += f"| {' | '.join([*cells, found.confidence, _cell(found.source)])} |\n"
    text += (
        "\n## Aerosols\n\n`atmosphere.aerosol_type` says which particles there are. Rural and tropospheric: Shettle & "
        "Fenn, AFGL-TR-79-0214 (1979), as tabulated in LOWTRAN 7 (Kneizys et al., AFGL-TR-88-0177). The others are "
        "spheres by their sizes and indices, `[atmosphere.own_aerosol]` your own.\n\n| type | is |\n|---|---|\n"
    )
    text += "".join(f"| `{name}` | {said} |\n" for name, said in _enum(aerosol_models, aerosol_models.AerosolType))
    text += (
        "\n`atmosphere.aerosol` says what they do to polarization, [the largest uncertainty of the sky](atmosphere.md)."
    )
    text += "\n\n| kind | is |\n|---|---|\n"
    return text + "".join(f"| `{name}` | {said} |\n" for name, said in _enum(phase, phase.AerosolKind))


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


PAGES = {"codes.md": codes_page, "materials.md": materials_page}


if __name__ == "__main__":
    for page, make in PAGES.items():
        (DOCS / page).write_text(make(), encoding="utf-8")
