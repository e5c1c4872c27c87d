"""`rigctl tradeoff`: the time that accuracy costs, in computation or in a session on the roof."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from rigctl.console import Json, note, solving_shown, steps_shown
from rigctl.errors import ConfigError
from rigctl.files.choices import COMMA_SEPARATED
from rigctl.verbs.options import FilePath, Files, Part, Result, Writes

if TYPE_CHECKING:
    from model.accuracy.predict import Predicted
    from rigctl.calibrations.noise import NoiseParameters
    from rigctl.files.scene_file import SceneFile
    from rigctl.prediction.sessions import AcquisitionTradeoff
    from rigctl.prediction.tradeoff import Curves, NamedChoice
    from rigctl.report.document import AnyTable

_SMALLEST, _LARGEST = 1e-5, 0.1
_TOLERANCES = (0.1, 0.03, 0.01, 0.003, 0.001)
_MS_PER_S = 1000.0
_PERCENT_A_MINUTE = 0.01 / 60.0
_ACCURACY_FILES = ("tradeoff.csv", "tradeoff.json", "tradeoff.png", "settings.png", "stages.png")
_ACQUISITION_FILES = ("acquisition.csv", "acquisition.json", "acquisition.png")
_NO_ERROR_STATED = "states no error"


def tradeoff(
    scene: FilePath,
    /,
    *,
    noise: FilePath | None = None,
    tolerances: Annotated[
        Sequence[float], COMMA_SEPARATED, Parameter(validator=Number(gte=_SMALLEST, lte=_LARGEST))
    ] = _TOLERANCES,
    also: Sequence[str] = (),
    wide: bool = False,
    acquisition: bool = False,
    target_dolp_sigma: float | None = None,
    p_detection: float | None = None,
    p_false_alarm: float = 1e-3,
    region: str | None = None,
    pair: Annotated[Sequence[str] | None, COMMA_SEPARATED] = None,
    pixels: int = 1,
    drift_percent_per_min: float = 1.0,
    settling_time_ms: float = 0.0,
    out: Annotated[FilePath | None, Writes(kind="folder", names=(*_ACCURACY_FILES, *_ACQUISITION_FILES))] = None,
) -> "AccuracyTradeoff | AcquisitionResult":
    """Show which numerical tolerance is worth its time for a scene; with --acquisition, which session is.

    The table compares tolerances with fixed choices as in the paper (midpoint tiles, a sky kept every 10 deg,
    first-order DoLP, random draws for the ROC, one wavelength, single scattering), and with your own (--also). Times
    are measured on this machine. True errors are differences from the finest settings.

    Example: rigctl tradeoff examples/scene-airborne.toml --out tradeoff

    Example: rigctl tradeoff examples/scene-airborne.toml --acquisition --target-dolp-sigma 0.002

    Parameters
    ----------
    scene : path
        Scene file.
    noise : path
        Noise calibration file, in place of the assumed noise.
    tolerances : sequence of float
        Tolerances to show, 1e-5 to 0.1, separated by commas; small ones take longest.
    also : sequence of "KEY=VALUE,..."
        Own choice of settings to show as well, such as tiles_per_side=3,rule=midpoint. Repeatable.
    wide : bool
        Also show each setting alone, the settings chosen for each tolerance, and the effect of uncertain inputs; with
        --acquisition, all columns.
    acquisition : bool
        Trade session time instead: frames, angles and exposure against the error of DoLP.
    target_dolp_sigma : float
        With --acquisition: find the shortest session with this error of DoLP.
    p_detection : float
        With --acquisition: probability of detection to reach.
    p_false_alarm : float
        With --acquisition: probability of a false alarm.
    region : str
        With --acquisition: region whose DoLP counts.
    pair : "TARGET,BACKGROUND"
        With --acquisition: regions to tell apart.
    pixels : int
        With --acquisition: pixels averaged before DoLP is taken.
    drift_percent_per_min : float
        With --acquisition: drift of the light [%/min].
    settling_time_ms : float
        With --acquisition: settling time of the polarizer [ms].
    out : path
        Folder for table, numbers and plots: tradeoff.png (the answer), settings.png (each setting alone), stages.png
        (where the time goes).
    """
    from rigctl.calibrations.noise import read_noise_file
    from rigctl.files.scene_file import load_scene

    if not acquisition and any(option is not None for option in (target_dolp_sigma, p_detection, region, pair)):
        raise ConfigError("--target-dolp-sigma, --p-detection, --region and --pair: are for --acquisition; give it too")
    file, parameters = load_scene(Path(scene)), None if noise is None else read_noise_file(Path(noise))
    found: AccuracyTradeoff | AcquisitionResult
    if not acquisition:
        found = AccuracyTradeoff(curves=_curves(file, parameters, tuple(tolerances), tuple(also)), is_wide=wide)
    else:
        from model.acquisition import Disturbances, Wanted
        from rigctl.prediction.sessions import TradeoffRequest, acquisition_tradeoff

        try:
            request = TradeoffRequest(
                wanted=Wanted(dolp_total=target_dolp_sigma, p_detection=p_detection, p_false_alarm=p_false_alarm),
                region=region,
                pair=_pair(pair),
                pixels=pixels,
                disturbances=Disturbances(
                    drift_per_s=drift_percent_per_min * _PERCENT_A_MINUTE, settling_time_s=settling_time_ms / _MS_PER_S
                ),
            )
            with solving_shown():
                sessions = acquisition_tradeoff(file, parameters, request)
        except ValueError as error:
            raise ConfigError(f"--acquisition: {error}") from error
        found = AcquisitionResult(found=sessions, is_wide=wide)
    if out is not None:
        note(f"written: {', '.join(found.write(Path(out)))} in {out}", below=True)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class AccuracyTradeoff(Result):
    """Error and time of tolerances, of the paper's choices and of each numerical setting."""

    curves: "Curves"
    is_wide: bool = False

    def content(self) -> Iterable[Part]:
        """Return the recommended tolerance, the table of tolerances and choices, and why some seem better."""
        from rigctl.report.tradeoff import choice_table, curve_png, curve_table, floor_lines

        yield self._answer()
        yield self._table()
        yield from self._explanation()
        if self.is_wide:
            yield curve_table(self.curves)
            yield choice_table(self.curves)
            yield from floor_lines(self.curves)
        yield f"the finest settings took {self.curves.reference_s:.3g} s"
        yield lambda: curve_png(self.curves, worth=self.worth)

    @property
    def worth(self) -> "Predicted":
        """The recommended prediction: of the largest tolerance within the uncertainty of DoLP from the inputs."""
        from rigctl.report.tradeoff import dolp_floor

        predictions, floor = self.curves.predictions, dolp_floor(self.curves)
        within = [one for one in predictions if floor is not None and one.tolerance <= floor]
        return max(within, key=lambda one: one.tolerance) if within else predictions[-1]

    def _answer(self) -> str:
        from rigctl.report.tradeoff import dolp_floor

        floor, worth, shown = dolp_floor(self.curves), self.worth, self.curves.predictions
        below = [one for one in shown if one.tolerance < worth.tolerance]
        price = f"--tolerance {worth.tolerance:g} costs {_seconds(worth):.2g} s"
        step = f", the next step down ({below[0].tolerance:g}) {_seconds(below[0]):.2g} s" if below else ""
        if floor is None:
            return f"The inputs have no uncertainty, so every tolerance buys something: {price}."
        if worth.tolerance > floor:
            return f"A tolerance down to {floor:.2g} buys accuracy of DoLP (uncertainty of the inputs): {price}."
        return (
            f"A tolerance below {floor:.2g} buys nothing for DoLP, for the inputs are not known better: {price}{step}."
        )

    def _table(self) -> "AnyTable":
        from rigctl.prediction.tradeoff import WHOLE_CHAIN
        from rigctl.report.document import Table, text_columns

        better = set(self._seemingly_better())
        rows = [
            (
                f"--{point.level}",
                f"{point.seconds:.2g}",
                _error(point.true),
                _error(point.estimated),
                "worth having" if point.level == f"tolerance {self.worth.tolerance:g}" else "",
            )
            for point in self.curves.points
            if point.varied == WHOLE_CHAIN
        ]
        rows += [
            (one.name, f"{one.seconds:.2g}", _error(one.error), "-", _words(one, is_better=one.name in better))
            for one in self.curves.named
        ]
        titles = ("choice", "seconds", "true error", "stated error", "")
        return Table(columns=text_columns(*titles, left=(0, 4)), rows=tuple(rows))

    def _seemingly_better(self) -> Iterable[str]:
        """Yield choices that are faster and better than a tolerance, but state no error."""
        from rigctl.prediction.tradeoff import faster_and_better

        return (one.name for one in self.curves.named if faster_and_better(one, self.curves))

    def _explanation(self) -> Iterable[str]:
        from rigctl.prediction.tradeoff import EVERY_10_DEG, PLANNED_GRID, estimates_share

        better = set(self._seemingly_better())
        if better:
            yield (
                f'"{_NO_ERROR_STATED}": faster and better here than a tolerance, because all other settings were '
                f"chosen finer beforehand, and nothing is spent on error estimates ({estimates_share(self.worth):.0%} "
                f"of the time of --tolerance {self.worth.tolerance:g}); only the finest settings tell the error"
            )
        if EVERY_10_DEG in better:
            kept, planned = (
                one for name in (EVERY_10_DEG, PLANNED_GRID) for one in self.curves.named if one.name == name
            )
            yield (
                f"The planner has a sky as good: with all other settings the same, {PLANNED_GRID} errs by "
                f"{_error(planned.error)} ({planned.seconds:.2g} s), a {EVERY_10_DEG} by {_error(kept.error)} "
                f"({kept.seconds:.2g} s)."
            )

    def as_json(self) -> dict[str, Json]:
        """Return the content of tradeoff.json."""
        from rigctl.report.tradeoff import curve_json

        return curve_json(self.curves)

    def output_files(self) -> Files:
        """Return table, numbers and plots."""
        from rigctl.report.tradeoff import curve_png, curve_table, settings_png, stages_png

        return {
            "tradeoff.csv": curve_table(self.curves),
            "tradeoff.json": self.as_json(),
            "tradeoff.png": curve_png(self.curves, worth=self.worth),
            "settings.png": settings_png(self.curves),
            "stages.png": stages_png(self.curves),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class AcquisitionResult(Result):
    """Error of DoLP and time of sessions, and the shortest session that reaches the target."""

    found: "AcquisitionTradeoff"
    is_wide: bool = False

    def content(self) -> Iterable[Part]:
        """Return the shortest session or the smallest error, the table of sessions, and assumptions."""
        from rigctl.report.tradeoff import assumptions, proposal, reached_table, reasons
        from rigctl.report.tradeoff import ways_table as curve_table

        text = proposal(self.found)
        if text is not None:
            yield text
        elif self.found.reached:
            yield "no session that was tried reaches it"
        else:
            yield self._best()
        if self.found.reached:
            yield reached_table(self.found, wide=self.is_wide)
        yield curve_table(self.found, wide=self.is_wide)
        yield from assumptions(self.found)
        yield from reasons(self.found)
        yield from self.found.remarks

    def _best(self) -> str:
        from model.acquisition import degrees_text

        known = [point for point in self.found.points if math.isfinite(point.worst.total)]
        if not known:
            return "no session gives a DoLP"
        best = min(known, key=lambda point: point.worst.total)
        session = best.session
        return (
            f"error of DoLP down to {best.worst.total:.2g}, after {session.duration_s:.0f} s at "
            f"{degrees_text(session.angles_rad)} deg ({session.pattern}, {session.cycles} cycles)"
        )

    def as_json(self) -> dict[str, Json]:
        """Return the content of acquisition.json."""
        from rigctl.report.tradeoff import tradeoff_json

        return tradeoff_json(self.found)

    def output_files(self) -> Files:
        """Return table, numbers and plot."""
        from rigctl.report.tradeoff import points_table, tradeoff_picture

        return {
            "acquisition.csv": points_table(self.found),
            "acquisition.json": self.as_json(),
            "acquisition.png": tradeoff_picture(self.found),
        }


def _curves(
    file: "SceneFile", noise: "NoiseParameters | None", tolerances: tuple[float, ...], also: tuple[str, ...]
) -> "Curves":
    from model.accuracy.plan import optical_depth
    from model.accuracy.predict import DEEPEST
    from rigctl.errors import as_config_error
    from rigctl.prediction.predict import ScenePredictor
    from rigctl.prediction.tradeoff import Curves, accuracy_curves, steps
    from rigctl.scene.light import SceneLight

    predictor = ScenePredictor(file, noise, light=SceneLight())
    with as_config_error(f"scene {predictor.scene.name}"), steps_shown() as tell:
        depth = optical_depth(predictor.lit_scene())
        if depth > DEEPEST:
            raise ConfigError(
                f"scene {predictor.scene.name}: its optical depth is {depth:.3g}, allowed for a trade-off is "
                f"{DEEPEST:g}: the reference for deeper air takes minutes. rigctl predict --tolerance says what coarse "
                "settings keep"
            )
        for done, step in enumerate(accuracy_curves(predictor, tolerances, also=also)):
            if isinstance(step, Curves):
                return step
            tell(step, done, steps(tolerances))
    raise RuntimeError("the curves ended without a result")


def _pair(names: Sequence[str] | None) -> tuple[str, str] | None:
    if names is None:
        return None
    if len(names) != 2 or not all(names):
        raise ConfigError(f"--pair: is {','.join(names)!r}, must be TARGET,BACKGROUND")
    return names[0], names[1]


def _seconds(found: "Predicted") -> float:
    return sum(found.stage_s.values())


def _words(choice: "NamedChoice", *, is_better: bool) -> str:
    if is_better:
        return _NO_ERROR_STATED
    return "no error" if choice.error == 0.0 else ""


def _error(value: float) -> str:
    return "-" if math.isnan(value) else "0" if value == 0.0 else f"{value:.1e}"
