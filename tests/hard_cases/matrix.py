"""The matrix of hard cases: each command run on each case, and what it answers."""

import contextlib
import io
import json
import math
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.cli import main
from rigctl.console.failures import EXIT_CODES
from rigctl.console.terminal import print_json
from rigctl.report.comparison import compared_json
from rigctl.verbs.compare import compare_run
from tests.hard_cases.cases import HardCase
from tests.rigctl.comparison.panel_runs import panel_run

FAULT = 70
# Done; and what a comparison that disagrees ends with.
_ANSWERED = (0, 5)
_LONGEST_WORDS = 160
# Of a sum of a few products, each of double precision.
_ROUNDING = 1e-14


@dataclass(frozen=True, kw_only=True)
class Cell:
    """What a command made of a case.

    Attributes
    ----------
    exit_code
        Of the command.
    words
        The number that it answers, or the words of its refusal.
    fault
        Why that is not acceptable; empty where it is.
    seconds
        That it took.
    """

    exit_code: int
    words: str
    fault: str
    seconds: float


Answer = Mapping[str, Any]


def _region(answer: Answer) -> Answer:
    found: Answer = answer["regions"]["black"]
    return found


def _dolp(answer: Answer) -> str:
    found = _region(answer)
    parts = [f"DoLP {found['dolp']['mean']:.6g}"] if "dolp" in found else ["no DoLP (no light)"]
    if "dolp_snr" in found and "mean" in found["dolp_snr"]:
        parts.append(f"SNR {found['dolp_snr']['mean']:.4g}")
    elif "dolp" in found:
        parts.append("no SNR")
    return ", ".join(parts)


def _promised(answer: Answer) -> str:
    accuracy = answer["accuracy"]
    errors = [one["error"] for one in accuracy["estimated_errors"] if one["error"] is not None]
    missing, worst = len(accuracy["not_promised"]), max(errors, default=0.0)
    return f"{_dolp(answer)}; estimated error {worst:.1e}, {f'{missing} not promised' if missing else 'kept'}"


def _swept(answer: Answer) -> str:
    found = answer["regions"]["black"].get("dolp", {}).get("mean", [])
    return "DoLP " + (", ".join("none" if one is None else f"{one:.6g}" for one in found) or "none (no light)")


def _uncertain(answer: Answer) -> str:
    found = {key: _region(answer).get(key, {}).get("mean_std_error_inputs") for key in ("s0", "dolp")}
    known = (f"{key} +- {error:.2g}" for key, error in found.items() if error is not None)
    return ", ".join(known) or "no number has an error"


def _acting(answer: Answer) -> str:
    return f"{sum(one['acts'] for one in answer['effects'])} of {len(answer['effects'])} act"


def _traded(answer: Answer) -> str:
    (chain,) = (one for one in answer["points"] if one["knob"] == "whole chain")
    return f"true {_number(chain['true_error'])} of 0.1 asked"


def _detected(answer: Answer) -> str:
    (pair,) = (one for one in answer["detection"] if (one["target"], one["background"]) == ("black", "white"))
    found = pair["p_detection"]["0.001"]
    if found is None or pair["auc"] is None:
        return "no P_D: " + "; ".join(pair["warnings"])
    return f"P_D {found:.6g} at 1e-3, area {pair['auc']:.6g}"


def _verdict(answer: Answer) -> str:
    return str(answer["verdict"])


def _number(value: float | None) -> str:
    return "none (nothing promised)" if value is None else f"{value:.1e}"


@dataclass(frozen=True, kw_only=True)
class Column:
    """A command of the matrix: its words, where SCENE and RUN stand for paths, and what is read of its answer."""

    name: str
    words: tuple[str, ...]
    read: Callable[[Answer], str]


COLUMNS: tuple[Column, ...] = (
    Column(name="predict", words=("predict", "SCENE"), read=_dolp),
    Column(name="--tolerance", words=("predict", "SCENE", "--tolerance", "0.01"), read=_promised),
    Column(name="sweep", words=("sweep", "SCENE", "sensor.f_number=2:2.5:2"), read=_swept),
    Column(name="uncertainty", words=("predict", "SCENE", "--uncertainty"), read=_uncertain),
    Column(name="effects", words=("effects", "SCENE"), read=_acting),
    Column(name="tradeoff", words=("tradeoff", "SCENE", "--tolerances", "0.1"), read=_traded),
    Column(name="ROC", words=("predict", "SCENE"), read=_detected),
    Column(name="compare", words=("compare", "RUN", "SCENE"), read=_verdict),
)


def cell(case: HardCase, column: Column, folder: Path) -> Cell:
    """Return what a command makes of a case.

    Parameters
    ----------
    case, column
        Which.
    folder
        For its files.
    """
    scene, run = folder / "scene.toml", folder / "run"
    scene.write_text(case.text)
    if case.surface:
        (folder / "surface.toml").write_text(case.surface)
    if "RUN" in column.words and not run.exists():
        panel_run(run, seed=3)
    paths = {"SCENE": str(scene), "RUN": str(run), "OUT": str(folder / "out")}
    words = [paths.get(word, word) for word in column.words]
    out, err = io.StringIO(), io.StringIO()
    start = time.perf_counter()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = _compared(run, scene) if column.name == "compare" else main([*words, "--json"])
    return _cell(case, column, code, out.getvalue(), err.getvalue(), seconds=time.perf_counter() - start)


def _compared(run: Path, scene: Path) -> int:
    """Compare without pages and figures, which take most of the time; ends as the command does."""
    try:
        print_json(compared_json(compare_run(run, scene=scene, calibrations="none")))
    except tuple(kind for kind, _ in EXIT_CODES) as error:
        sys.stderr.write(f"rigctl: {error}\n")
        return next(code for kind, code in EXIT_CODES if isinstance(error, kind))
    except Exception as error:
        sys.stderr.write(f"rigctl: {type(error).__name__}: {error}\n")
        return FAULT
    return 0


def _cell(case: HardCase, column: Column, code: int, out: str, err: str, *, seconds: float) -> Cell:
    if code == FAULT:
        return Cell(exit_code=code, words=_short(err), fault="a fault of the program", seconds=seconds)
    if code not in _ANSWERED:
        silent = "" if err.strip() else "refused in silence"
        return Cell(exit_code=code, words=f"refused ({code}): {_short(err)}", fault=silent, seconds=seconds)
    answer = json.loads(out)
    strange = [number for number in _numbers(answer) if not math.isfinite(number)]
    fault = f"{len(strange)} numbers are not finite" if strange else _off(case, column, answer)
    return Cell(exit_code=code, words=_short(column.read(answer)), fault=fault, seconds=seconds)


def _off(case: HardCase, column: Column, answer: Answer) -> str:
    """Why DoLP is not what the case states; empty where it is, or where nothing is stated."""
    if case.dolp is None or column.read is not _dolp:
        return ""
    found = _region(answer)["dolp"]["mean"]
    # A share of S0: the counts carry no more digits than S0 does.
    return "" if abs(found - case.dolp) <= _ROUNDING * case.condition else f"DoLP {found!r} in place of {case.dolp!r}"


def _numbers(content: object) -> Iterator[float]:
    if isinstance(content, dict):
        content = list(content.values())
    if isinstance(content, list):
        for one in content:
            yield from _numbers(one)
    elif isinstance(content, float):
        yield content


def _short(text: str) -> str:
    plain = re.sub(r"/\S*/(scene\.toml|surface\.toml)", r"\1", " ".join(text.split()))
    plain = plain.removeprefix("rigctl: ").replace("|", "/")
    return plain if len(plain) <= _LONGEST_WORDS else plain[: _LONGEST_WORDS - 4] + " ..."
