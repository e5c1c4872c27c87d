"""The study file: varied numbers of scenes, and results for every case."""

from math import prod
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from rigctl.files.toml import Section, load

CaseKind = Literal["grid", "list", "latin", "random", "sobol"]
# Kinds with random draws: each parameter needs a law.
DrawnKind = Literal["latin", "random", "sobol"]
DRAWN: tuple[DrawnKind, ...] = get_args(DrawnKind)
# A case takes some 600 bytes before it is computed.
MOST_CASES = 1_000_000


class VariedSection(Section):
    """Variation of one number: by values, steps, or a law for draws."""

    values: Annotated[tuple[float, ...] | None, Field(min_length=1)] = None
    """Its values, in the unit of the scene file; kinds with draws choose one at random. Example: `[10, 30, 50]`."""
    start: float | None = None
    """First of `n` values at even steps. Example: `10.0`."""
    stop: float | None = None
    """Last of them, included. Example: `70.0`."""
    n: Annotated[int | None, Field(ge=1, le=MOST_CASES)] = None
    """How many. Example: `7`."""
    range: tuple[float, float] | None = None
    """Limits of a rectangular law. Example: `[10.0, 40.0]`."""
    std: Annotated[float, Field(gt=0)] | Literal["stated"] | None = None
    """Deviation of a normal law round the scene's number; "stated": as the scene file says. Example: `"stated"`."""

    @model_validator(mode="after")
    def _one_form(self) -> "VariedSection":
        steps = (self.start, self.stop, self.n)
        given = [self.values is not None, any(x is not None for x in steps), self.range is not None]
        if sum((*given, self.std is not None)) != 1 or (given[1] and None in steps):
            raise ValueError("needs one of values = [..], start, stop and n together, range = [..], or std")
        if self.range is not None and not self.range[0] < self.range[1]:
            raise ValueError(f"range is {list(self.range)}; the first number must be below the second")
        return self

    @property
    def is_drawn(self) -> bool:
        """Whether it has a law: a range or a deviation."""
        return self.range is not None or self.std is not None

    @property
    def size(self) -> int:
        """Number of values or steps; 0 for a law."""
        return (self.n or 0) if self.values is None else len(self.values)

    @property
    def steps(self) -> tuple[float, ...]:
        """Its values or steps; empty for a law."""
        if self.values is not None:
            return self.values
        if self.start is None or self.stop is None or self.n is None:
            return ()
        width = (self.stop - self.start) / max(self.n - 1, 1)
        return tuple(self.stop if 0 < k == self.n - 1 else self.start + k * width for k in range(self.n))


class CasesSection(Section):
    """Which cases there are."""

    kind: CaseKind
    """Every combination, lists side by side, or draws; `sobol` also ranks the inputs. Example: `"grid"`."""
    n: Annotated[int | None, Field(ge=1, le=MOST_CASES)] = None
    """Draws; of `sobol` a power of two, of which it takes (inputs + 2) times as many. Example: `256`."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Of the draws. Example: `1`."""
    parameters: Annotated[dict[str, VariedSection], Field(min_length=1)]
    """Key of the parameter table to how it is varied. Example: `{ "sun.zenith_deg" = { values = [20, 60] } }`."""

    @model_validator(mode="after")
    def _fits_kind(self) -> "CasesSection":
        if (self.kind in DRAWN) != (self.n is not None):
            raise ValueError(f'kind = "{self.kind}" ' + ("needs n" if self.n is None else "takes no n"))
        if self.kind == "sobol" and self.n is not None and self.n & (self.n - 1):
            raise ValueError(f"n is {self.n}; for sobol it must be a power of two, for instance 256")
        for key, one in self.parameters.items():
            if self.kind in ("grid", "list") and one.is_drawn:
                raise ValueError(f'parameters."{key}": kind = "{self.kind}" needs values, or start, stop and n')
            if self.kind == "sobol" and not one.is_drawn:
                raise ValueError(f'parameters."{key}": kind = "{self.kind}" needs a law: range or std')
        sizes = {key: one.size for key, one in self.parameters.items()}
        if self.kind == "list" and len(set(sizes.values())) > 1:
            told = ", ".join(f"{key} {size}" for key, size in sizes.items())
            raise ValueError(f'kind = "list" takes values side by side and needs equal numbers of them: {told}')
        if self.size > MOST_CASES:
            axes = " x ".join(f"{key} {size}" for key, size in sizes.items())
            told = f"n = {self.n} makes" if self.kind in DRAWN else f"{axes} are"
            raise ValueError(f"{told} {self.size} cases of each scene, allowed are {MOST_CASES} in all")
        return self

    @property
    def size(self) -> int:
        """Number of cases of each scene."""
        if self.n is not None:
            return self.n * (len(self.parameters) + 2 if self.kind == "sobol" else 1)
        sizes = [one.size for one in self.parameters.values()]
        return prod(sizes) if self.kind == "grid" else sizes[0]


class StudyFile(Section):
    """Content of a study file."""

    schema_version: Literal[1] = 1
    """Version of the layout. Example: `1`."""
    name: Annotated[str, Field(pattern=r"\S")]
    """Name of the study. Example: `"panels over a year"`."""
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)]
    """Scene files, relative to this one. Example: `["scene-airborne.toml"]`."""
    quantities: Annotated[tuple[str, ...], Field(min_length=1)]
    """NAME or NAME.STATISTIC of a region, or p_detection, auc. Example: `["dolp.mean", "dolp_snr", "p_detection"]`."""
    roc: str | None = None
    """TARGET,BACKGROUND: the pair with whole ROC curves in the result. Example: `"black_paint,asphalt"`."""
    cases: CasesSection
    """What is varied."""

    @model_validator(mode="after")
    def _fits_memory(self) -> "StudyFile":
        if len(self.scenes) * self.cases.size > MOST_CASES:
            each = f"{len(self.scenes)} scenes with {self.cases.size} cases each"
            raise ValueError(f"{each} are too many, allowed are {MOST_CASES} cases in all")
        return self


def load_study(path: Path) -> StudyFile:
    """Return the checked study file; its scenes are relative to it."""
    study = load(path, StudyFile)
    return study.model_copy(update={"scenes": tuple((path.parent / scene).resolve() for scene in study.scenes)})
