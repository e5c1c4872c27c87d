"""The matrix of hard cases: what each command answers to each case, and the run of each case compared with it."""

import contextlib
import io
import json
import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rigctl.cli import main
from rigctl.console import EXIT_CODES
from rigctl.verbs.compare import compare_run
from tests.hard_cases.cases import HardCase
from tests.hard_cases.own_run import draw_run
from tests.hard_cases.references import BACKGROUND, ROUNDING, TARGET, Known, Reference, reference_of

FAULT = 70
_LONGEST_WORDS = 200
TOLERANCE = 0.01

Answer = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """What a command makes of a case."""

    exit_code: int
    answer: Answer  #: empty where it refused
    words: str  #: of the refusal
    fault: str  #: why that is not acceptable; empty where it is


#: The commands by their names in the page; SCENE stands for the path of the scene file.
COMMANDS: Mapping[str, str] = {
    "predict": "predict SCENE",
    "--tolerance": f"predict SCENE --tolerance {TOLERANCE}",
    "sweep": "sweep SCENE sensor.f_number=2:2.5:2",
    "--uncertainty": "predict SCENE --uncertainty",
    "effects": "effects SCENE",
    "tradeoff": "tradeoff SCENE --tolerances 0.1",
}


def written(case: HardCase, folder: Path) -> Path:
    """Return the path of the scene file of a case."""
    scene = folder / "scene.toml"
    scene.write_text(case.text)
    if case.surface:
        (folder / "surface.toml").write_text(case.surface)
    return scene


def cell(case: HardCase, command: str, folder: Path) -> Cell:
    """Return what a command makes of a case: words in which SCENE and OUT stand for paths."""
    paths = {"SCENE": str(written(case, folder)), "OUT": str(folder / "out")}
    words = [paths.get(word, word) for word in command.split()]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([*words, "--json"])
    said = short(err.getvalue())
    if code == FAULT:
        return Cell(exit_code=code, answer={}, words=said, fault="a fault of the program")
    if code != 0:
        return Cell(exit_code=code, answer={}, words=said, fault="" if said else "refused in silence")
    answer = json.loads(out.getvalue())
    strange = [number for number in _numbers(answer) if not math.isfinite(number)]
    return Cell(exit_code=0, answer=answer, words="", fault=f"{len(strange)} numbers not finite" if strange else "")


@dataclass(frozen=True, kw_only=True)
class Row:
    """All that is known of a case: numbers and words as the page shows them."""

    name: str
    refused: str = ""  #: words of the refusal, which all commands share; empty where the case is answered
    exit_code: int = 0
    source: str = ""  #: of the reference
    dolp: Known | None = None  #: of the reference, and so on
    snr: Known | None = None
    p_detection: Known | None = None
    ours: Mapping[str, float] = field(default_factory=dict)  #: "dolp", "snr", "p_detection", "tolerance", "estimated"
    verdict: str = ""  #: of its run compared with it
    reason: str = ""
    answers: Mapping[str, str] = field(default_factory=dict)  #: of the other commands
    faults: tuple[str, ...] = ()
    seconds: float = 0.0  #: of the processor

    @property
    def error(self) -> float | None:
        """Error of DoLP by `predict`; None without a reference."""
        return abs(self.ours["dolp"] - self.dolp.value) if self.dolp and "dolp" in self.ours else None

    @property
    def error_to_tolerance(self) -> float | None:
        """Error of DoLP by `predict --tolerance`."""
        return abs(self.ours["tolerance"] - self.dolp.value) if self.dolp and "tolerance" in self.ours else None


def row_of(case: HardCase, folder: Path) -> Row:
    """Return the row of a case: every command, the reference, and its own run compared with it."""
    begun = time.process_time()
    cells = {"predict": cell(case, COMMANDS["predict"], folder)}
    refused = cells["predict"].exit_code != 0
    # A trade-off of a sky takes minutes; of a refused scene none is begun.
    is_dear = "material" in case.text and not refused
    cells |= {name: cell(case, COMMANDS[name], folder) for name in list(COMMANDS)[1 : -1 if is_dear else None]}
    faults = [f"{name}: {one.fault}" for name, one in cells.items() if one.fault]
    if refused:
        first = cells["predict"]
        faults += [f"{name} answers" for name, one in cells.items() if one.exit_code != first.exit_code]
        row = Row(name=case.name, refused=first.words, exit_code=first.exit_code, faults=tuple(faults))
    else:
        reference = reference_of(case, folder / "scene.toml")
        verdict, reason = _compared(reference, folder)
        row = Row(
            name=case.name,
            source=reference.source,
            dolp=reference.dolp,
            snr=reference.snr,
            p_detection=reference.p_detection,
            ours=_ours(cells),
            verdict=verdict,
            reason=reason,
            answers={name: _text(name, one) for name, one in cells.items()},
            faults=(*faults, *_off(case, cells["predict"])),
        )
    return Row(**{**vars(row), "seconds": round(time.process_time() - begun, 1)})


def _ours(cells: Mapping[str, Cell]) -> dict[str, float]:
    answer = cells["predict"].answer
    found = {"dolp": _dolp(answer), "snr": _region(answer).get("dolp_snr", {}).get("mean")}
    found["p_detection"] = _detection(answer)["p_detection"]["0.001"]
    if cells["--tolerance"].answer:
        accurate = cells["--tolerance"].answer
        errors = {(one["place"], one["quantity"], one["statistic"]): one["error"] for one in _estimated(accurate)}
        found |= {"tolerance": _dolp(accurate), "estimated": errors.get((TARGET, "dolp", "mean"))}
    return {name: value for name, value in found.items() if value is not None}


def _compared(reference: Reference, folder: Path) -> tuple[str, str]:
    """Return the verdict on the run that is drawn from the light of the reference, and its reason."""
    run = folder / "run"
    try:
        draw_run(run, reference.scene, reference.light)
    except ValueError as error:
        return "not drawn", short(str(error))
    try:
        found = compare_run(run, scene=folder / "scene.toml", calibrations="none")
    except tuple(kind for kind, _ in EXIT_CODES) as error:
        return "cannot be judged", short(str(error))
    if found.verdict == "disagrees":
        rows = (f"{row.region} {row.quantity} {row.statistic}" for row in found.disagreements)
        return "disagrees", short(", ".join(rows))
    reasons = dict.fromkeys(one.reason for one in found.regions.values() if one.reason)
    return found.verdict.replace("_", " "), short("; ".join(reasons))


def _off(case: HardCase, found: Cell) -> Iterator[str]:
    """Yield why DoLP is not what the case states, to rounding."""
    if case.dolp is None or not found.answer:
        return
    ours = _dolp(found.answer)
    # A share of S0: the counts carry no more digits than S0 does.
    if ours is None or abs(ours - case.dolp) > ROUNDING * case.condition:
        yield f"DoLP {ours!r} in place of {case.dolp!r}"


def _text(name: str, one: Cell) -> str:
    if one.fault:
        return f"**{one.fault}**: {one.words}"
    return f"refused ({one.exit_code}): {one.words}" if one.exit_code else _READ[name](one.answer)


def _region(answer: Answer) -> Answer:
    found: Answer = answer["regions"][TARGET]
    return found


def _dolp(answer: Answer) -> float | None:
    found: float | None = _region(answer).get("dolp", {}).get("mean")
    return found


def _detection(answer: Answer) -> Answer:
    (pair,) = (one for one in answer["detection"] if (one["target"], one["background"]) == (TARGET, BACKGROUND))
    found: Answer = pair
    return found


def _estimated(answer: Answer) -> list[Answer]:
    found: list[Answer] = answer["accuracy"]["estimated_errors"]
    return found


def _detected(answer: Answer) -> str:
    pair = _detection(answer)
    found = pair["p_detection"]["0.001"]
    if found is None or pair["auc"] is None:
        return "no P_D: " + "; ".join(pair["warnings"])
    return f"area {pair['auc']:.6g}"


def _promised(answer: Answer) -> str:
    errors = [one["error"] for one in _estimated(answer) if one["error"] is not None]
    missing = len(answer["accuracy"]["not_promised"])
    return f"{max(errors, default=0.0):.1e}, {f'{missing} not promised' if missing else 'kept'}"


def _swept(answer: Answer) -> str:
    found = answer["regions"][TARGET].get("dolp", {}).get("mean", [])
    return ", ".join("none" if one is None else f"{one:.6g}" for one in found) or "none (no light)"


def _uncertain(answer: Answer) -> str:
    found = {key: _region(answer).get(key, {}).get("mean_std_error_inputs") for key in ("s0", "dolp")}
    sizes = {key: 0.0 if error is not None and error < ROUNDING else error for key, error in found.items()}
    return ", ".join(f"{key} ± {error:.2g}" for key, error in sizes.items() if error is not None) or "no error known"


def _acting(answer: Answer) -> str:
    return f"{sum(one['acts'] for one in answer['effects'])} of {len(answer['effects'])}"


def _traded(answer: Answer) -> str:
    (chain,) = (one for one in answer["points"] if one["knob"] == "whole chain")
    return "nothing promised" if chain["true_error"] is None else f"{chain['true_error']:.1e}"


_READ: Mapping[str, Callable[[Answer], str]] = {
    "predict": _detected,
    "--tolerance": _promised,
    "sweep": _swept,
    "--uncertainty": _uncertain,
    "effects": _acting,
    "tradeoff": _traded,
}


def _numbers(content: object) -> Iterator[float]:
    if isinstance(content, dict):
        content = list(content.values())
    if isinstance(content, list):
        for one in content:
            yield from _numbers(one)
    elif isinstance(content, float):
        yield content


def short(text: str) -> str:
    """Return words without folders, and cut where they are long."""
    plain = re.sub(r"/\S*/(scene\.toml|surface\.toml)", r"\1", " ".join(text.split()))
    plain = re.sub(r"^rigctl: (scene hard: |scene\.toml: 1 problem )?", "", plain).replace("|", "/")
    return plain if len(plain) <= _LONGEST_WORDS else plain[: _LONGEST_WORDS - 4] + " ..."
