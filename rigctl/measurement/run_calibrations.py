"""The calibrations that a run is compared with: read, found to be of its devices, and what is doubtful about them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from rigctl.calibrations.flat.flat_file import FlatFields, read_fitting_flats
from rigctl.calibrations.noise.noise_file import NoiseParameters, read_fitting_noise
from rigctl.calibrations.polarizer.polarizer_file import PolarizerParameters, read_fitting_polarizer
from rigctl.calibrations.radiometric_file import RadiometricResponse, read_fitting_radiometric
from rigctl.calibrations.registration.registration_file import ImageRegistration, read_fitting_registration
from rigctl.calibrations.store import KINDS, CalibrationKind
from rigctl.files.regions import Region
from rigctl.files.rig_file import PLACEHOLDER
from rigctl.measurement.corrections import FoundCorrections
from rigctl.measurement.flat_division import flat_remarks
from rigctl.measurement.measurement import Measurement, measure
from rigctl.measurement.throughput_division import Throughput
from rigctl.runs.run_folder import Run

_MOVED = (
    "frames were moved to lie on one another, bilinearly: the prediction of temporal noise follows that; texture and "
    "fixed pattern of single pixels are smoothed too, and their prediction is not"
)

_Content = TypeVar("_Content")
_Read = Callable[[Path, Run], tuple[_Content, tuple[str, ...]]]


@dataclass(frozen=True, kw_only=True)
class CalibrationPaths:
    """Files of calibrations, None is not given; a registration that helps no edges is used only if that is forced.

    Attributes
    ----------
    noise, radiometric, registration, flat, polarizer : Path or None
        Files that are named.
    force_registration : bool
        Use a registration that helps no edges too.
    picks : bool
        Pick what is not named from the store, where there is one.
    store : Path or None
        The store; None is the one that stands beside the rig file.
    without : tuple of str
        Kinds that are not picked.
    """

    noise: Path | None = None
    radiometric: Path | None = None
    registration: Path | None = None
    flat: Path | None = None
    polarizer: Path | None = None
    force_registration: bool = False
    picks: bool = False
    store: Path | None = None
    without: tuple[str, ...] = ()

    @property
    def files(self) -> dict[CalibrationKind, Path]:
        """Files that are named, by their kind."""
        named = {kind: getattr(self, kind) for kind in KINDS}
        return {kind: path for kind, path in named.items() if isinstance(path, Path)}

    def with_files(self, files: Mapping[CalibrationKind, Path]) -> "CalibrationPaths":
        """Return them with more files."""
        together = self.files | dict(files)
        return replace(
            self,
            noise=together.get("noise"),
            radiometric=together.get("radiometric"),
            registration=together.get("registration"),
            flat=together.get("flat"),
            polarizer=together.get("polarizer"),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RunCalibrations:
    """Contents of calibration files, as far as there are any, and doubts about using them for a run, in words."""

    noise: NoiseParameters | None
    radiometric: RadiometricResponse | None
    registration: ImageRegistration | None
    flats: FlatFields | None
    polarizer: PolarizerParameters | None
    doubts: tuple[str, ...]
    force_registration: bool = False

    def measure(self, run: Run, regions: list[Region], found: FoundCorrections | None = None) -> Measurement:
        """Return what a run measured, processed with them, and corrected by what it shows of itself."""
        return measure(
            run,
            regions=regions,
            noise=self.noise,
            registration=self.registration,
            flats=self.flats,
            polarizer=self.polarizer,
            found=found,
            may_measure_none=True,
        )


def read_calibrations(paths: CalibrationPaths, run: Run) -> RunCalibrations:
    """Return the calibrations of a run.

    Raises
    ------
    DataError
        A file is wrong, or of other devices or settings.
    """
    doubts = [f"{run.path}: {PLACEHOLDER}"] if run.session.polarizer.placeholder and paths.polarizer is None else []

    def read(path: Path | None, reader: _Read[_Content]) -> _Content | None:
        if path is None:
            return None
        content, more = reader(path, run)
        doubts.extend(more)
        return content

    return RunCalibrations(
        noise=read(paths.noise, read_fitting_noise),
        radiometric=read(paths.radiometric, read_fitting_radiometric),
        registration=read(paths.registration, read_fitting_registration),
        flats=read(paths.flat, read_fitting_flats),
        polarizer=read(paths.polarizer, read_fitting_polarizer),
        doubts=tuple(doubts),
        force_registration=paths.force_registration,
    )


def correction_remarks(measurement: Measurement, regions: list[Region]) -> tuple[str, ...]:
    """Return what was done to frames by calibrations, and what that leaves unpredicted, in words."""
    done = measurement.corrections
    return (
        *(() if done.throughput is None else (_of_throughput(done.throughput),)),
        *(() if done.flat is None else flat_remarks(done.flat, regions)),
        *(() if done.shifts is None else (_MOVED,)),
    )


def _of_throughput(throughput: Throughput) -> str:
    values = throughput.value.tolist()
    return (
        f"frames were divided by the throughput of their angle, {min(values):.4f} to {max(values):.4f}, known to "
        f"{throughput.error.max():.2%}"
    )
