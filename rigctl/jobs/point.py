"""Where camera and panels point: what a person has measured and what pictures show in; angles with errors out."""

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.pointing.camera_pose import UNKNOWN_STD_RAD, CameraPose, PoseSource, fuse, refraction_rad
from calibration.pointing.lens import Lens, plain_lens
from calibration.pointing.panel_pose import PanelStand, PanelTilt, panel_stands, panel_tilt
from calibration.pointing.sources import SunSeen, compass, level, level_panel, positions, shadow, sun_in_picture
from rigctl.calibrations.lens_file import read_lens_file
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError, DataError
from rigctl.files.place import Place
from rigctl.files.regions import Region, load_regions
from rigctl.files.scene_file import load_scene
from rigctl.files.scene_writing import write_into_scene
from rigctl.numbers.utc_time import is_utc_text, utc_moment
from rigctl.runs.run_folder import Run
from rigctl.runs.wholeness import used_run
from rigctl.scene.skies.sun_position import sun_position

FloatArray = NDArray[np.float64]

_SIZE = re.compile(r"(?P<name>[^=]+)=(?P<width>[\d.]+)x(?P<height>[\d.]+)")
_LEVEL = re.compile(r"(?P<name>[^=]+)=(?P<std>[\d.]+)")
_WITH_STD = re.compile(r"(?P<values>[-+\d.eE,\s]+?)\s*\+-\s*(?P<std>[\d.eE]+)")
# Half a minute of a clock that nobody set moves the sun by an eighth of a degree.
_SUN_STD_DEG = 0.02
# A degree of latitude [m]; of two places on one roof this is enough.
_M_PER_DEG = 111_194.9
_CORNERS = 4
# A panel that is tilted by less than this many of its errors leans nowhere.
_LEANS = 3.0


@dataclass(frozen=True, kw_only=True)
class PointRequest:
    """What is known of where camera and panels point; angles in degrees, texts as the command line has them.

    Attributes
    ----------
    run : Path
        Run folder: time, site, size of the picture.
    outlines : Path or None
        Scene or regions file with the outlines of panels, four corners each.
    lens, focal_px : Path or None, str or None
        Lens calibration, or focal length with its error.
    compass, declination, level : str or None
        Reading of a compass, declination (east positive), elevation and roll by a level, each with its error.
    camera_at, target_at : str or None
        Latitude, longitude, height, with the error of each in metres.
    sun, shadow : str or None
        Pixel of the sun; pixels of foot and tip of an upright rod's shadow.
    pixel_std : float
        Standard uncertainty of each coordinate of sun, shadow and corners [pixel].
    at_ns : int or None
        When the picture of sun or shadow was taken; None is the middle of the run.
    panels, level_panels : tuple of str
        ``NAME=WIDTHxHEIGHT`` in metres; ``NAME=STD`` of those that lie level within STD degrees.
    write : Path or None
        Scene file that the angles are written into.
    """

    run: Path
    outlines: Path | None = None
    lens: Path | None = None
    focal_px: str | None = None
    compass: str | None = None
    declination: str | None = None
    level: str | None = None
    camera_at: str | None = None
    target_at: str | None = None
    sun: str | None = None
    shadow: str | None = None
    pixel_std: float = 0.5
    at_ns: int | None = None
    panels: tuple[str, ...] = ()
    level_panels: tuple[str, ...] = ()
    write: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Pointed:
    """Where camera and panels point.

    Attributes
    ----------
    pose : CameraPose
        Of the camera.
    sources : tuple of str
        What it was found from.
    panels : mapping
        Tilt of each panel.
    unclear : mapping
        Panels whose outline fits two stands, and both in words.
    sun_deg : (azimuth, elevation) or None
        As it is seen, where it was needed [deg].
    changes : tuple of str
        Lines of the scene file that went and came.
    """

    pose: CameraPose
    sources: tuple[str, ...]
    panels: Mapping[str, PanelTilt]
    unclear: Mapping[str, str]
    sun_deg: tuple[float, float] | None
    changes: tuple[str, ...] = ()

    @property
    def geometry(self) -> dict[str, tuple[float, float]]:
        """Keys of a scene's ``[geometry]`` with value and standard uncertainty, those that are determined [deg]."""
        azimuth, elevation, roll = np.degrees(self.pose.angles_rad).tolist()
        stds = self.pose.std_rad
        found = {}
        if stds[1] < UNKNOWN_STD_RAD and -90.0 < elevation <= 0.0:
            found["camera_zenith_deg"] = (90.0 + elevation, float(np.degrees(stds[1])))
        if stds[0] < UNKNOWN_STD_RAD:
            found["camera_azimuth_deg"] = ((azimuth + 180.0) % 360.0, float(np.degrees(stds[0])))
        if stds[2] < UNKNOWN_STD_RAD:
            found["camera_roll_deg"] = (roll, float(np.degrees(stds[2])))
        return found

    @property
    def regions(self) -> dict[str, dict[str, tuple[float, float]]]:
        """Keys of each panel's region with value and standard uncertainty [deg]."""
        return {name: _tilt_numbers(tilt) for name, tilt in self.panels.items()}

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Which sources the others exclude, in words."""
        return tuple(
            f"{one.name} contradicts the other sources (chi-square {one.chi_square:.1f}, p = {one.p_value:.1g}); all "
            "uncertainties are widened by that: look at it, or leave it out"
            for one in self.pose.contradictions
        )

    def as_json(self) -> dict[str, Json]:
        """Return the answer of `rigctl point`."""
        names = ("azimuth_deg", "elevation_deg", "roll_deg")
        numbers = zip(names, np.degrees(self.pose.angles_rad).tolist(), np.degrees(self.pose.std_rad), strict=True)
        return {
            "camera_looks": {name: {"value": value, "std": float(std)} for name, value, std in numbers},
            "covariance_deg2": (np.degrees(1.0) ** 2 * self.pose.covariance).tolist(),
            "geometry": _as_numbers(self.geometry),
            "regions": {name: _as_numbers(numbers) for name, numbers in self.regions.items()},
            "unclear": dict(self.unclear),
            "sources": list(self.sources),
            "chi_square": self.pose.chi_square,
            "degrees_of_freedom": self.pose.freedom,
            "contradictions": list(self.contradictions),
            "sun_deg": None if self.sun_deg is None else list(self.sun_deg),
            "changes": list(self.changes),
        }


def _as_numbers(numbers: Mapping[str, tuple[float, float]]) -> dict[str, Json]:
    return {key: {"value": value, "std": std} for key, (value, std) in numbers.items()}


def _tilt_numbers(tilt: PanelTilt) -> dict[str, tuple[float, float]]:
    found = {"tilt_deg": (float(np.degrees(tilt.tilt_rad)), float(np.degrees(tilt.tilt_std_rad)))}
    if tilt.tilt_rad > _LEANS * tilt.tilt_std_rad:
        found["tilt_azimuth_deg"] = (float(np.degrees(tilt.azimuth_rad)), float(np.degrees(tilt.azimuth_std_rad)))
    return found


def point(request: PointRequest) -> Pointed:
    """Return where camera and panels point, once that is written into the scene where that is wanted.

    Raises
    ------
    ConfigError, DataError, CalibrationError
        A text or a file is wrong, nothing is known, or an outline is none of a panel of this size.
    """
    run = used_run(request.run)
    sun = _sun(request, run) if request.sun or request.shadow else None
    stands = _stands(request, run)
    stated = list(_stated(request, run, sun))
    known = [(name, np.radians(std)) for name, std in _levels(request.level_panels)]
    missing = [name for name, _ in known if name not in stands]
    if missing:
        raise ConfigError(f"--level-panel: {', '.join(missing)}: give its size too, --panel {missing[0]}=0.6x0.4")
    if not stated and not known:
        raise ConfigError("nothing says where the camera looks: give --compass, --level, --sun, --shadow or another")
    tries = itertools.product(*(stands[name] for name, _ in known))
    chosen = [_with_panels(stated, known, lying) for lying in tries]
    pose, sources = min(((fuse(sources), sources) for sources in chosen), key=lambda found: found[0].chi_square)
    others = {name: found for name, found in stands.items() if name not in dict(known)}
    tilts = {
        name: [panel_tilt(one, pose.angles_rad, pose.covariance) for one in found] for name, found in others.items()
    }
    found = Pointed(
        pose=pose,
        sources=tuple(one.name for one in sources),
        panels={name: rows[0] for name, rows in tilts.items() if len(rows) == 1},
        unclear={name: _both(rows) for name, rows in tilts.items() if len(rows) > 1},
        sun_deg=None if sun is None else (float(np.degrees(sun.azimuth_rad)), float(np.degrees(sun.elevation_rad))),
    )
    if request.write is None:
        return found
    changes = write_into_scene(request.write, found.geometry, found.regions)
    return Pointed(**(vars(found) | {"changes": changes}))


def _with_panels(
    stated: Sequence[PoseSource], known: Sequence[tuple[str, float]], lying: Sequence[PanelStand]
) -> list[PoseSource]:
    panels = zip(known, lying, strict=True)
    return [*stated, *(level_panel(name, stand.normal, stand.covariance, std) for (name, std), stand in panels)]


def _both(tilts: Sequence[PanelTilt]) -> str:
    rows = (f"tilt {np.degrees(one.tilt_rad):.1f} toward {np.degrees(one.azimuth_rad):.0f} deg" for one in tilts)
    return " or ".join(rows) + ": the outline fits both; a larger picture of it, or its corners better, would tell"


def _stated(request: PointRequest, run: Run, sun: SunSeen | None) -> Iterable[PoseSource]:
    """Give what the request says of the camera's direction."""
    if (request.compass is None) != (request.declination is None):
        raise ConfigError("--compass, --declination: give both; a compass shows magnetic north")
    if request.compass is not None and request.declination is not None:
        (reading,), std = _numbers("--compass", request.compass, 1)
        (declination,), declination_std = _numbers("--declination", request.declination, 1)
        angles = np.radians([reading, std, declination, declination_std]).tolist()
        yield compass(angles[0], angles[1], declination_rad=angles[2], declination_std_rad=angles[3])
    if request.level is not None:
        (elevation, roll), std = _numbers("--level", request.level, 2)
        yield level(*np.radians([elevation, roll, std]).tolist())
    if (request.camera_at is None) != (request.target_at is None):
        raise ConfigError("--camera-at, --target-at: give both")
    if request.camera_at is not None and request.target_at is not None:
        yield _positions(request.camera_at, request.target_at)
    if request.sun is not None and sun is not None:
        x, y = _pixels("--sun", request.sun, 2)
        yield sun_in_picture(np.array([x, y]), request.pixel_std, sun, _lens(request, run))
    if request.shadow is not None and sun is not None:
        ends = np.array(_pixels("--shadow", request.shadow, 4)).reshape(2, 2)
        yield shadow(ends[0], ends[1], request.pixel_std, sun, _lens(request, run))


def _numbers(option: str, text: str, count: int) -> tuple[list[float], float]:
    """Return the numbers of an option and their standard uncertainty, which has to be said."""
    found = _WITH_STD.fullmatch(text.strip())
    try:
        values = [float(word) for word in found["values"].split(",")] if found else []
        std = float(found["std"]) if found else 0.0
    except ValueError:
        values, std = [], 0.0
    if len(values) != count or not std > 0.0 or not np.isfinite([*values, std]).all():
        example = ",".join(["12.5", "0.3", "160"][:count])
        raise ConfigError(
            f"{option}: is {text!r}; write {count} number{'s' * (count > 1)} and an error: '{example} +- 1'"
        )
    return values, std


def _pixels(option: str, text: str, count: int) -> list[float]:
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise ConfigError(f"{option}: is {text!r}; write {count} numbers, pixels right and down, with commas")
    return values


def _positions(camera: str, target: str) -> PoseSource:
    (latitude, longitude, height), std = _numbers("--camera-at", camera, 3)
    (there_latitude, there_longitude, there_height), there_std = _numbers("--target-at", target, 3)
    east = (there_longitude - longitude) * _M_PER_DEG * np.cos(np.radians(latitude))
    between = np.array([east, (there_latitude - latitude) * _M_PER_DEG, there_height - height])
    if float(np.hypot(between[0], between[1])) < np.hypot(std, there_std):
        raise ConfigError("--camera-at, --target-at: lie nearer to one another than their errors: no direction follows")
    return positions(between, np.full(3, np.hypot(std, there_std)))


def _lens(request: PointRequest, run: Run) -> Lens:
    frame = run.frames[0] if run.frames else None
    if frame is None:
        raise DataError(f"{run.path}: holds no frames, so that the size of its pictures is not known")
    if request.lens is not None:
        found = read_lens_file(request.lens)
        if (found.width, found.height) != (frame.width, frame.height):
            raise DataError(
                f"{request.lens}: is of pictures of {found.width} x {found.height} pixels, those of the run have "
                f"{frame.width} x {frame.height}"
            )
        return found.lens()
    if request.focal_px is None:
        raise ConfigError("--lens FILE, or --focal-px '1500 +- 20': pixels say nothing of directions without a lens")
    (focal,), std = _numbers("--focal-px", request.focal_px, 1)
    if not focal > 0.0:
        raise ConfigError(f"--focal-px: is {focal:g}; must be above 0")
    return plain_lens(focal, std, frame.width, frame.height)


def _stands(request: PointRequest, run: Run) -> dict[str, tuple[PanelStand, ...]]:
    if not request.panels:
        return {}
    if request.outlines is None:
        raise ConfigError("--outlines FILE: a scene or regions file with the four corners of each panel")
    regions = {region.name: region for region in _regions(request.outlines)}
    found = {}
    for text in request.panels:
        size = _SIZE.fullmatch(text)
        if size is None or min(float(size["width"]), float(size["height"])) <= 0.0:
            raise ConfigError(f"--panel: is {text!r}; write its name and sides in metres, white_panel=0.6x0.4")
        corners = _corners(request.outlines, regions, size["name"])
        try:
            lens = _lens(request, run)
            found[size["name"]] = panel_stands(
                corners, float(size["width"]), float(size["height"]), request.pixel_std, lens
            )
        except CalibrationError as error:
            raise CalibrationError(f"panel {size['name']}: {error}") from error
    return found


def _regions(path: Path) -> Sequence[Region]:
    try:
        return load_regions(path)
    except ConfigError:
        return load_scene(path).regions


def _corners(path: Path, regions: Mapping[str, Region], name: str) -> FloatArray:
    if name not in regions:
        raise ConfigError(f"--panel: {path} has no region {name}; there are {', '.join(regions)}")
    polygon = regions[name].polygon
    if polygon is None or len(polygon) != _CORNERS:
        raise ConfigError(
            f"--panel: {name} in {path} is no polygon of four corners; give those of the panel itself, in order, the "
            "first side its width"
        )
    return np.array(polygon, dtype=np.float64)


def _levels(texts: Iterable[str]) -> Iterable[tuple[str, float]]:
    for text in texts:
        found = _LEVEL.fullmatch(text)
        if found is None or not float(found["std"]) > 0.0:
            raise ConfigError(f"--level-panel: is {text!r}; write its name and how level it lies in degrees, white=0.3")
        yield found["name"], float(found["std"])


def _sun(request: PointRequest, run: Run) -> SunSeen:
    """Return the sun as it is seen from the run's site, in the middle of the run or at the time that is given."""
    site = run.session.site
    place = None if site is None else site.place
    if place is None and run.frames and run.frames[0].site_latitude_deg is not None:
        first = run.frames[0]
        place = Place(
            latitude_deg=first.site_latitude_deg or 0.0,
            longitude_deg=first.site_longitude_deg or 0.0,
            elevation_m=first.site_elevation_m or 0.0,
        )
    if place is None:
        raise DataError(f"{run.path}: has no site, and the sun stands elsewhere for each: [site] in the rig file")
    moment = _moment(request, run)
    found = sun_position(moment, place)
    elevation = 0.5 * np.pi - found.zenith_rad
    if elevation < 0.0:
        raise DataError(f"{run.path}: the sun is below the horizon at {moment:%Y-%m-%dT%H:%M:%SZ}")
    return SunSeen(
        azimuth_rad=found.azimuth_rad,
        elevation_rad=elevation + refraction_rad(elevation),
        std_rad=float(np.radians(_SUN_STD_DEG)),
    )


def _moment(request: PointRequest, run: Run) -> datetime:
    if request.at_ns is not None:
        return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=request.at_ns // 1000)
    times = [utc_moment(one.start_utc) for one in run.frames if one.start_utc and is_utc_text(one.start_utc)]
    if not times:
        raise DataError(f"{run.path}: its frames do not say when they were taken; --at TIME")
    return min(times) + (max(times) - min(times)) / 2
