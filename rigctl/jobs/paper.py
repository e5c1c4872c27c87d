"""The paper, figure by figure and sentence by sentence: computed, judged and written."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.files.choices import SnrForm
from rigctl.files.scene_file import load_scene
from rigctl.paper import (
    ASSUMED,
    FIGURES,
    Airborne,
    LowLight,
    MaterialSet,
    PaperResult,
    PaperScenes,
    Rooftop,
    assumed_lines,
    chosen,
    read_digitised,
    results,
    search,
)

SHIPPED = ("library", "rough")
_LEAST_HEIGHT_M, _MOST_HEIGHT_M = 1.0, 90_000.0


@dataclass(frozen=True, kw_only=True)
class PaperRequest:
    """What of the paper is asked for.

    Attributes
    ----------
    figures : tuple of int
        Which; empty for all.
    materials : tuple of str
        "library", "rough", or paths of scene files like theirs.
    snr : {"exact", "first-order"}
        DoLP SNR in which statements are checked.
    height_m : float
        Height of the camera where the paper states none [m].
    as_paper : bool
        Whether everything is computed as the authors did too.
    search : int
        How many random sets of materials are tried.
    seed : int
        Of these.
    digitised : Path or None
        CSV of points of the paper's figures.
    out : Path or None
        Folder.
    """

    figures: tuple[int, ...] = ()
    materials: tuple[str, ...] = SHIPPED
    snr: SnrForm = "exact"
    height_m: float = 3000.0
    as_paper: bool = False
    search: int = 0
    seed: int = 1
    digitised: Path | None = None
    out: Path | None = None


def check_paper(request: PaperRequest, *, progress: Callable[[str], None] = lambda _: None) -> PaperResult:
    """Return what comes out of the paper's figures and statements.

    Parameters
    ----------
    request : PaperRequest
        What is asked for.
    progress : callable
        Told what is being done.

    Raises
    ------
    ConfigError
        A figure is not there, or a file is wrong.
    """
    _require_possible(request)
    points = () if request.digitised is None else read_digitised(request.digitised)
    low_light = LowLight()
    sets = []
    for name in dict.fromkeys(request.materials):
        progress(f"{name}: computing")
        sets.append(_set(name, request, low_light))
    found = None
    if request.search:
        found = search(
            sets[0].scene,
            sets[0].scenes,
            sets=request.search,
            seed=request.seed,
            progress=lambda count: progress(f"search: {count} of {request.search}"),
        )
    result = PaperResult(
        sets=tuple(sets),
        figures=request.figures or FIGURES,
        search=found,
        points=points,
        remarks=tuple(_remarks(request)),
    )
    if request.out is not None:
        from rigctl.paper import write_paper

        write_paper(result, request.out)
    return result


def _require_possible(request: PaperRequest) -> None:
    unknown = set(request.figures) - set(FIGURES)
    if unknown:
        raise ConfigError(f"--figure: {min(unknown)} is not computed; there are {', '.join(map(str, FIGURES))}")
    if not _LEAST_HEIGHT_M <= request.height_m <= _MOST_HEIGHT_M:
        limits = f"{_LEAST_HEIGHT_M:g} to {_MOST_HEIGHT_M:g}"
        raise ConfigError(f"--height-m: is {request.height_m:g}, allowed is {limits}")
    if request.search and request.figures:
        raise ConfigError("--search: counts all statements; leave out --figure")


def _set(name: str, request: PaperRequest, low_light: LowLight) -> MaterialSet:
    if name in SHIPPED:
        with as_file(files("rigctl") / "data" / "examples" / "paper") as folder:
            scene, assumed = load_scene(folder / f"{name}.toml"), assumed_lines(folder / f"{name}.toml")
    else:
        scene, assumed = load_scene(Path(name)), assumed_lines(Path(name))
    label = name if name in SHIPPED else Path(name).stem
    airborne = Airborne(scene, snr=request.snr)
    scenes = PaperScenes(airborne=airborne, rooftop=Rooftop(airborne), low_light=low_light, height_m=request.height_m)
    other = None
    if request.as_paper:
        authors = Airborne(scene, light=airborne.light, as_paper=True)
        other = PaperScenes(airborne=authors, rooftop=scenes.rooftop, low_light=low_light, height_m=request.height_m)
    return MaterialSet(
        name=label,
        scene=scene,
        scenes=scenes,
        as_paper=other,
        results=results(scenes, label, chosen(request.figures), as_paper=other),
        assumed=(*assumed, *airborne.predictor.remarks),
    )


def _remarks(request: PaperRequest) -> Iterable[str]:
    yield (
        f"assumed: {request.height_m / 1000:g} km where the paper states no height (Figs 9, 12 to 15; --height-m), "
        "and both views where it states none (Fig. 15)"
    )
    rooftop = ", ".join(f"{key} = {value:g}" for key, value in ASSUMED.items())
    yield f"assumed for section III (Figs 6 to 8): {rooftop}"
    yield "assumed for Fig. 2: the sun, air and band of section V, for Table I of the paper is not at hand"
    if request.as_paper:
        yield (
            "as the paper computes: 3 x 3 tiles at their midpoints, a sky on a 10 deg grid, 1e5 draws of target and of "
            "background, DoLP SNR to first order; number of tiles and their place are assumed"
        )
