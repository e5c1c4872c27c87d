"""Results as a notebook shows them: the records of the jobs, with a short text, HTML, and tables of their numbers."""

from collections.abc import Iterable
from operator import itemgetter
from typing import Any

from rigctl.calibrations.rig_picks import RigPicks
from rigctl.comparison.compared_run import ComparedRun
from rigctl.console.json_text import Json
from rigctl.interface.data_frames import Backend, Number, data_frame, measured_numbers, number_table, optional
from rigctl.jobs.predict import PredictedScene, SweptScene
from rigctl.jobs.stokes import StokesOfRun
from rigctl.measurement.picked_calibrations import PickedCalibrations
from rigctl.reports.figures.comparison_figures import scores
from rigctl.reports.figures.measurement_figures import scene_pictures
from rigctl.reports.figures.prediction_figures import sweep_png
from rigctl.reports.figures.scene_figures import sky_picture
from rigctl.reports.table import Column, Table
from rigctl.reports.tables.comparison_tables import check_table, summary_table
from rigctl.reports.tables.light_tables import sky_lines
from rigctl.reports.tables.numbers_json import region_statistics
from rigctl.reports.tables.prediction_tables import quantity_tables
from rigctl.reports.tables.row_table import row_table
from rigctl.reports.tables.surface_tables import surface_tables
from rigctl.reports.tables.sweep_tables import sweep_tables
from rigctl.reports.writers.html_page import lines_fragment, picture_fragment, table_fragment
from rigctl.scene.reflected_light import SurfaceSheet
from rigctl.scene.sky_map import SkyMap

_AGREES = {True: "model and measurement agree", False: "model and measurement DISAGREE", None: "cannot be judged"}


def _calibrations(picked: PickedCalibrations | RigPicks | None) -> dict[str, Json]:
    picks = () if picked is None or picked.store is None else (one.pick for one in picked.choices)
    return {one.kind: one.as_json() for one in picks if one is not None}


def _with(picked: PickedCalibrations | RigPicks | None) -> str:
    picks = () if picked is None else (one.pick for one in picked.choices)
    files = [f"{one.kind} {one.file.name}" for one in picks if one is not None]
    return f", with {', '.join(files)}" if files else ""


class Prediction(PredictedScene):
    """What the model says of a scene: `rigctl.jobs.predict.PredictedScene`, shown and as a table."""

    def __repr__(self) -> str:
        return f"<prediction of {', '.join(self.found.predictions)}{_with(self.picked)}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty where there is no store."""
        return _calibrations(self.picked)

    def _repr_html_(self) -> str:
        numbers = {name: prediction.quantities for name, prediction in self.found.predictions.items()}
        tables = "".join(table_fragment(table) for table in quantity_tables(numbers))
        return tables + lines_fragment((*self.picked.lines, *self.found.remarks))

    def table(self, *, backend: Backend = "pandas") -> Any:
        """Return every predicted number: region, quantity, statistic, value, std_error_inputs.

        Parameters
        ----------
        backend : {"pandas", "polars"}
            Whose data frame. The error is there after ``predict(..., uncertainty=True)``.
        """
        return data_frame(number_table(self._numbers(), error="std_error_inputs"), backend)

    def _numbers(self) -> Iterable[Number]:
        errors = {} if self.uncertainty is None else self.uncertainty.std_errors
        for region, prediction in self.found.predictions.items():
            for quantity, statistics in prediction.quantities.items():
                for statistic, value in statistics.items():
                    error = errors.get(region, {}).get(quantity, {}).get(statistic)
                    yield region, quantity, statistic, value, error


class SweepResult(SweptScene):
    """What the model says over a range of one number: `rigctl.jobs.predict.SweptScene`, shown and as a table."""

    def __repr__(self) -> str:
        values = self.found.values
        span = f"{len(values)} values from {values[0]:g} to {values[-1]:g}"
        return f"<sweep of {self.found.key}, {span}{_with(self.picked)}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty where there is no store."""
        return _calibrations(self.picked)

    def _repr_html_(self) -> str:
        tables = "".join(table_fragment(table) for table in sweep_tables(self.found))
        return picture_fragment(sweep_png(self.found)) + tables + lines_fragment((*self.picked.lines, *self.remarks))

    def table(self, *, backend: Backend = "pandas") -> Any:
        """Return every number at every value: key, at, region, quantity, statistic, value."""
        key, found = self.found.key, self.found
        rows = tuple(
            (float(at), region, quantity, statistic, value)
            for at, step in zip(found.values, found.quantities, strict=True)
            for region, quantities in step.items()
            for quantity, statistics in quantities.items()
            for statistic, value in statistics.items()
        )
        names = (key, "region", "quantity", "statistic", "value")
        columns = tuple(Column[Any](key=name, value=itemgetter(k)) for k, name in enumerate(names))
        return data_frame(Table(columns=columns, rows=rows), backend)


class ComparisonResult(ComparedRun):
    """A run beside the model: `rigctl.comparison.compared_run.ComparedRun`, shown and as a table."""

    def __repr__(self) -> str:
        return f"<comparison of {self.measurement.run.path}: {_AGREES[self.agrees]}{_with(self.picked)}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty where there is no store."""
        return _calibrations(self.picked)

    def _repr_html_(self) -> str:
        off = tuple(sorted(self.comparison.disagreements, key=lambda row: -abs(row.z or 0.0)))
        parts = [lines_fragment([_AGREES[self.agrees]])]
        parts.append(table_fragment(summary_table(self.comparison, self.measurement)))
        if off:
            parts.append(table_fragment(row_table(off), most=20))
        parts.append(picture_fragment(scores(self.comparison)))
        return "".join(parts) + lines_fragment(self.comparison.remarks)

    @property
    def agrees(self) -> bool | None:
        """Whether model and measurement agree; None where that cannot be judged."""
        return self.comparison.agrees

    def table(self, *, backend: Backend = "pandas") -> Any:
        """Return every row of comparison.csv: predicted, measured, errors, scores, verdict."""
        return data_frame(row_table(self.comparison.rows), backend)


class StokesResult(StokesOfRun):
    """Stokes parameters of a run: `rigctl.jobs.stokes.StokesOfRun`, shown, as arrays and as a table."""

    def __repr__(self) -> str:
        grid = self.measurement.grid
        pixels = f"{grid.height} x {grid.width} pixels [{grid.unit}]"
        return f"<Stokes parameters of {self.measurement.run.path}: {pixels}{_with(self.picked)}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty where there is no store."""
        return _calibrations(self.picked)

    def _repr_html_(self) -> str:
        tables = quantity_tables({name: region_statistics(one) for name, one in self.measurement.regions.items()})
        return "".join(
            (
                picture_fragment(scene_pictures(self.measurement.images, [], unit=self.measurement.grid.unit)),
                *(table_fragment(table) for table in tables),
                table_fragment(check_table(self.checks)),
                lines_fragment((*(() if self.picked is None else self.picked.lines), *self.remarks)),
            )
        )

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

    def table(self, *, backend: Backend = "pandas") -> Any:
        """Return every measured number: region, quantity, statistic, value, std_error."""
        found = {name: region.quantities for name, region in self.measurement.regions.items()}
        return data_frame(number_table(measured_numbers(found), error="std_error"), backend)

    def to_xarray(self) -> Any:
        """Return the pictures as an `xarray.Dataset`: s0, s1, s2, dolp, aolp_deg and unusable over y and x."""
        images, unit = self.measurement.images, self.measurement.grid.unit
        units = {"s0": unit, "s1": unit, "s2": unit, "dolp": "1", "aolp_deg": "deg"}
        data: dict[str, Any] = {
            name: (("y", "x"), getattr(self, name), {"units": text}) for name, text in units.items()
        }
        data["unusable"] = (("y", "x"), images.unusable, {"long_name": "saturated or missing in any frame"})
        return optional("xarray").Dataset(data, attrs={"run": str(self.measurement.run.path)})


class SkyResult(SkyMap):
    """The sky of a scene: `rigctl.scene.sky_map.SkyMap`, shown and as a dataset."""

    def __repr__(self) -> str:
        return f"<sky of {self.name}, sun at zenith {self.sun_zenith_deg:.1f} deg>"

    def _repr_html_(self) -> str:
        return picture_fragment(sky_picture(self)) + lines_fragment(sky_lines(self))

    def to_xarray(self) -> Any:
        """Return s0, s1, s2 [W m-2 sr-1 in band] and dolp over zenith_deg and azimuth_deg as an `xarray.Dataset`."""
        places = ("zenith_deg", "azimuth_deg")
        unit = {"units": "W m-2 sr-1"}
        data: dict[str, Any] = {f"s{k}": (places, self.stokes[..., k], unit) for k in range(3)}
        data["dolp"] = (places, self.dolp, {"units": "1"})
        return optional("xarray").Dataset(data, coords={name: getattr(self, name) for name in places})


class SurfaceResult(SurfaceSheet):
    """What a material reflects: `rigctl.scene.reflected_light.SurfaceSheet`, shown and as a table."""

    def __repr__(self) -> str:
        return f"<{self.material} at {self.wavelength_nm:g} nm, sun at {self.sun_zenith_deg:g} deg>"

    def _repr_html_(self) -> str:
        return "".join(table_fragment(table) for table in surface_tables(self)) + lines_fragment(self.findings)

    def table(self, *, backend: Backend = "pandas") -> Any:
        """Return camera_zenith_deg, f00_per_sr, s1n and dolp in the plane of sun and normal."""
        keys = ("camera_zenith_deg", "f00_per_sr", "s1n", "dolp")
        return data_frame(
            Table(columns=tuple(Column[Any](key=key) for key in keys), rows=self.principal_plane), backend
        )
