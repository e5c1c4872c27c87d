"""Results as a notebook shows them: the records of the jobs, with a short text, HTML, and tables of their numbers."""

from collections.abc import Iterable
from operator import itemgetter
from typing import Any

from rigctl.console.json_text import Json
from rigctl.jobs.predict import PredictedScene, SweptScene
from rigctl.measurement.picked_calibrations import calibrations_json, named_calibrations
from rigctl.reports.data_frames import Backend, Number, data_frame, number_table
from rigctl.reports.figures.prediction_figures import sweep_png
from rigctl.reports.table import Column, Table
from rigctl.reports.tables.prediction_tables import quantity_tables
from rigctl.reports.tables.sweep_tables import sweep_tables
from rigctl.reports.writers.html_page import lines_fragment, picture_fragment, table_fragment


class Prediction(PredictedScene):
    """What the model says of a scene: `rigctl.jobs.predict.PredictedScene`, shown and as a table."""

    def __repr__(self) -> str:
        return f"<prediction of {', '.join(self.found.predictions)}{named_calibrations(self.picked)}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty where there is no store."""
        return calibrations_json(self.picked)

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
        return f"<sweep of {self.found.key}, {span}{named_calibrations(self.picked)}>"

    @property
    def calibrations(self) -> dict[str, Json]:
        """Calibrations by kind: file, sha256, why, age_days; empty where there is no store."""
        return calibrations_json(self.picked)

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
