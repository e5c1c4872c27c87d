"""`rigctl stokes`: Stokes parameters, DoLP and AoLP of a run, pixel by pixel and by regions."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Unpack

from cyclopts import Parameter

from rigctl.console import Json, note, warn
from rigctl.verbs.options import (
    FilePath,
    Files,
    FrameOptions,
    Part,
    RegionsPath,
    Result,
    RunPath,
    Writes,
    calibrations_of,
    regions_of,
)

if TYPE_CHECKING:
    from model.processing.samples import Texture
    from rigctl.comparison.checks import Check
    from rigctl.files.regions import Region
    from rigctl.measure.diagnose import MeasuredRun
    from rigctl.measure.frames import CalibrationPaths, SelectedCalibrations
    from rigctl.measure.measure import Measurement
    from rigctl.measure.pixel_errors import PixelErrors
    from rigctl.report.stokes_file import Plane
    from rigctl.runs.folder import Run as RunRecord

_MOST_ROWS = 12  # regions that are printed without --wide
FILES = (
    "stokes.json",
    "stokes.fits",
    "residual.png",
    "pictures.png",
    "aolp.png",
)


def stokes(
    run: RunPath,
    /,
    *,
    regions: RegionsPath | None = None,
    out: Annotated[FilePath | None, Writes(kind="folder", names=FILES), Parameter(required=True)] = None,
    wide: bool = False,
    **frames: Unpack[FrameOptions],
) -> "StokesResult":
    """Measure Stokes parameters, DoLP and AoLP of every pixel of a run, and of its regions.

    stokes.fits holds S0, S1 and S2 without the dark level, in DN, or in DN/s if exposures differ, with their errors and
    covariances, DoLP and AoLP with errors, and a mask. Calibrations that are not given are selected from the store next
    to the rig file (see rigctl calibrate list).

    Example: rigctl stokes runs/panels --regions examples/regions.toml --out stokes

    Parameters
    ----------
    run : path or Run
        Run folder.
    regions : path or sequence of Region
        Regions file.
    out : path
        Folder for images, pictures and numbers. Optional in Python.
    wide : bool
        Print all measured numbers of each region.
    **frames
        Calibrations and corrections, see `FrameOptions`.

    Returns
    -------
    StokesResult
        Pictures as arrays, numbers as a table.

    Raises
    ------
    ConfigError, DataError
        A file is wrong, or the run is unfit.
    """
    from rigctl.runs.check import run_to_measure

    found = stokes_of(
        run_to_measure(Path(run), ignore_exclusions=frames.get("ignore_exclusions", False)),
        regions_of(regions),
        calibrations_of(frames),
        correct=tuple(frames.get("correct", ())),
        is_wide=wide,
    )
    found.selected.report()
    for remark in found.run.remarks:
        warn(remark)
    if out is not None:
        note(f"written: {', '.join(found.write(Path(out)))} in {out}", below=True)
    for refusal in found.refused:
        warn(refusal)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class StokesResult(Result):
    """Stokes parameters of a run: arrays, a table, and the content of `stokes.json`."""

    run: "MeasuredRun"  #: measurement, regions, calibrations and faults of the run
    checks: "tuple[Check, ...]"  #: checks of the run
    is_wide: bool = False  #: show all numbers

    @property
    def measurement(self) -> "Measurement":
        """The numbers of the run and its regions."""
        return self.run.measurement

    @property
    def selected(self) -> "SelectedCalibrations":
        """Calibrations that were used, and those of them that were selected from the store."""
        return self.run.calibrations.selected

    def __repr__(self) -> str:
        grid = self.measurement.grid
        pixels = f"{grid.height} x {grid.width} pixels [{grid.unit}]"
        return f"<Stokes parameters of {self.measurement.run.path}: {pixels}{self.selected}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty without a store."""
        return self.selected.used

    @property
    def calibration_files(self) -> dict[str, Path]:
        """Files of the calibrations that were used, by kind."""
        return {str(kind): path for kind, path in self.selected.paths.files.items()}

    @property
    def s0(self) -> Any:
        """S0 of every pixel, (H, W) array, in the unit of the measurement."""
        return self.measurement.images.stokes[0]

    @property
    def s1(self) -> Any:
        """S1 of every pixel, horizontal - vertical, (H, W) array."""
        return self.measurement.images.stokes[1]

    @property
    def s2(self) -> Any:
        """S2 of every pixel, +45 - (-45) deg, (H, W) array."""
        return self.measurement.images.stokes[2]

    @property
    def dolp(self) -> Any:
        """DoLP of every pixel, (H, W) array; not a number where it has no meaning."""
        return self.measurement.images.dolp

    @property
    def aolp_deg(self) -> Any:
        """AoLP of every pixel, (H, W) array, counter-clockwise from horizontal, in [0, 180) [deg]."""
        return self.measurement.images.aolp_deg

    @cached_property
    def errors(self) -> "PixelErrors":
        """Noise errors of every pixel: covariance of S0, S1, S2, errors of DoLP and AoLP; and a mask of doubts."""
        from rigctl.measure.pixel_errors import pixel_errors

        return pixel_errors(self.measurement, self.run.calibrations.noise)

    @cached_property
    def textures(self) -> "dict[str, Texture] | None":
        """Texture of each region's Stokes parameters [grid.unit^2]; None without a noise calibration.

        Noise is subtracted, fixed pattern is not.
        """
        import numpy as np

        from model.processing.samples import estimate_texture
        from rigctl.measure.measure import temporal_noise, temporal_variance

        noise, inverse = self.run.calibrations.noise, self.measurement.plan.inverse
        if noise is None:
            return None
        temporal = temporal_noise(noise)
        return {
            name: estimate_texture(
                region.stokes_pixels_mean,
                (inverse * temporal_variance(self.measurement, region, temporal.values)) @ inverse.T,
                repeats=self.measurement.grid.cycles,
                pattern_cov=np.zeros((3, 3)),
            )
            for name, region in self.measurement.regions.items()
        }

    @property
    def planes(self) -> "dict[str, Plane]":
        """All pictures of the result by name, with unit and meaning; see docs/outputs.md."""
        from rigctl.report.stokes_file import planes_of

        return planes_of(self.measurement, self.errors)

    @property
    def refused(self) -> tuple[str, ...]:
        """Reasons why the run is unsound; empty if it is sound."""
        from rigctl.comparison.checks import refused_regions

        regions = {check.region for check in self.checks if check.region is not None}
        refused = refused_regions(self.checks)
        every = bool(regions) and regions == set(refused)
        return tuple(
            f"{check.name}: {check.text}"
            for check in self.checks
            if check.verdict == "refused" and (check.region is None or every)
        )

    @property
    def exit_code(self) -> int:
        """4 if the run is unsound, or if none of its regions can be measured."""
        from rigctl.console import EXIT_DATA

        return EXIT_DATA if self.refused or (self.run.regions and not self.measurement.regions) else 0

    @property
    def notes(self) -> tuple[str, ...]:
        """Calibrations that were selected, doubts and corrections."""
        return (*self.selected.lines, *self.run.remarks)

    def content(self) -> Iterable[Part]:
        """Return DoLP and AoLP, the run's faults, and with --wide all numbers of the regions and their texture."""
        from rigctl.report.measurement import region_statistics, scene_pictures, summary_table
        from rigctl.report.prediction import quantity_tables

        yield self._answer()
        yield self._clipped()
        regions = self.measurement.regions
        if regions and not self.is_wide:
            shown = dict(list(regions.items())[:_MOST_ROWS])
            yield summary_table(shown, unit=self.measurement.grid.unit)
            more = f"{len(regions) - len(shown)} more regions, and " if len(shown) < len(regions) else ""
            yield f"{more}every number with its deviations: --wide, or stokes.json"
        yield from self._faults()
        if self.is_wide:
            yield from quantity_tables({name: region_statistics(region) for name, region in regions.items()})
            yield from (_texture_line(name, texture) for name, texture in (self.textures or {}).items())
        yield lambda: scene_pictures(self.measurement.images, [], unit=self.measurement.grid.unit)

    def _answer(self) -> str:
        import numpy as np

        from rigctl.report.measurement import sample_text

        regions = {
            name: one.quantities["dolp"]["mean"]
            for name, one in self.measurement.regions.items()
            if "dolp" in one.quantities
        }
        if self.refused:
            return "UNSOUND: the numbers below are not those of the light"
        if regions:
            high = max(regions, key=lambda name: regions[name].value)
            among = f", the largest of {len(regions)} regions" if len(regions) > 1 else ""
            return f"DoLP {sample_text('dolp', regions[high])} ({high}){among}"
        if self.run.regions:
            return "no region can be measured"
        good = self.dolp[np.isfinite(self.dolp)]
        if not good.size:
            return "no pixel has a DoLP"
        middle, low_share, high_share = np.percentile(good, (50, 5, 95))
        return f"DoLP {middle:.4f} (median; 90 % of the pixels {low_share:.4f} to {high_share:.4f})"

    def _clipped(self) -> str:
        from rigctl.base.numbers import percent

        high, low = (percent(share) for share in self.measurement.clipped_shares)
        missing = float(self.measurement.frames.missing.mean())
        return f"clipped in one frame or more: {high} of the pixels at the upper end, {low} at 0" + (
            f"; missing: {percent(missing)}" if missing else ""
        )

    def _faults(self) -> Iterable[str]:
        from rigctl.comparison.checks import titled_texts
        from rigctl.measure.faults import term_text

        yield from (f"the run shows {term_text(term)}" for term in self.run.diagnosis.mentioned)
        yield from (f"{title}: {text}" for title, text in titled_texts(self.checks, "flagged", "refused"))
        yield from (f"{name} cannot be measured: {why}" for name, why in self.measurement.unmeasured.items())

    def as_json(self) -> dict[str, Json]:
        """Return the content of stokes.json."""
        from rigctl.report.measurement import diagnosis_json, measurement_json

        return measurement_json(self.measurement, self.textures) | {
            "unmeasured": self.measurement.unmeasured,
            "diagnosis": diagnosis_json(self.run.diagnosis),
            "checks": [asdict(check) for check in self.checks],
            "flags": [check.name for check in self.checks if check.verdict == "flagged"],
            "sound": not any(check.verdict == "refused" for check in self.checks),
            **self.selected.as_json(),
        }

    def output_files(self) -> Files:
        """Return images, masks, pictures and numbers."""
        from rigctl.report.measurement import stokes_files
        from rigctl.report.stokes_file import stokes_fits

        fits = stokes_fits(self.measurement, self.errors, self.calibration_files)
        return stokes_files(self.measurement, self.run.regions, fits=fits, numbers=self.as_json())

    def table(self, *, backend: Literal["pandas", "polars"] = "pandas") -> Any:
        """Return every measured number as a data frame: region, quantity, statistic, value, std_error."""
        from rigctl.report.document import Table, value_columns

        rows = tuple(
            (name, quantity, statistic, sample.value, sample.std_error)
            for name, region in self.measurement.regions.items()
            for quantity, statistics in region.quantities.items()
            for statistic, sample in statistics.items()
        )
        columns = value_columns("region", "quantity", "statistic", "value", "std_error")
        return Table(columns=columns, rows=rows).data_frame(backend)

    def to_xarray(self) -> Any:
        """Return all planes over y and x as an `xarray.Dataset`, and which pixels are unusable."""
        from rigctl.report.document import optional

        data: dict[str, Any] = {
            name: (("y", "x"), plane.values, {"units": plane.unit or "1", "long_name": plane.meaning})
            for name, plane in self.planes.items()
        }
        unusable = self.measurement.images.unusable
        data["unusable"] = (("y", "x"), unusable, {"long_name": "saturated or missing in any frame"})
        return optional("xarray").Dataset(data, attrs={"run": str(self.measurement.run.path)})


def stokes_of(
    run: "RunRecord",
    regions: "list[Region]",
    paths: "CalibrationPaths",
    *,
    correct: tuple[str, ...] = (),
    is_wide: bool = False,
) -> StokesResult:
    """Measure a run that is open."""
    from rigctl.comparison.checks import run_checks
    from rigctl.measure.diagnose import MEASURED_WITH, measure_run
    from rigctl.measure.frames import calibrations_of_run

    measured = measure_run(run, regions, calibrations_of_run(paths, run, MEASURED_WITH), correct=correct)
    return StokesResult(run=measured, checks=run_checks(measured), is_wide=is_wide)


def _texture_line(name: str, texture: "Texture") -> str:
    if math.isnan(texture.rank_one_share):
        return f"{name}: no texture above the noise"
    return (
        f"{name}: texture of {100 * texture.common_factor_rms:.2f} % as a factor common to S0, S1, S2; "
        f"{100 * texture.rank_one_share:.0f} % of it is one common variation"
        + (f" ({texture.remark})" if texture.remark else "")
    )
