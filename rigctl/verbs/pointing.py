"""`rigctl calibrate pointing`: directions of camera and panels, from measured angles and from pictures."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

from cyclopts import Parameter, validators

from rigctl.base.numbers import plus_minus, time_option
from rigctl.console import Json, note, warn
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Part, Result, RunPath, Writes

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibration.pointing.pose import CameraPose, Lens, PanelTilt
    from rigctl.files.place import PointingSection

    FloatArray = NDArray[np.float64]

# The azimuth of a tilt of fewer errors than this means nothing.
_LEANS = 3.0
# Smaller correlations are rounding; larger ones are cut so that they stay valid when rounded.
_NOT_NONE, _FIRM, _DIGITS = 1e-6, 1.0 - 1e-8, 10
# Largest number of correlations that are printed, and the least one; --write has all.
_SHOWN, _WORTH_A_LINE = 6, 0.1

# Negative numbers begin with a hyphen, like options.
_Text: TypeAlias = Annotated[str | None, Parameter(allow_leading_hyphen=True)]


def pointing(
    run: RunPath,
    /,
    *,
    lens: FilePath | None = None,
    focal_px: str | None = None,
    sun: _Text = None,
    compass: _Text = None,
    declination: _Text = None,
    level: _Text = None,
    camera_at: _Text = None,
    target_at: _Text = None,
    panel: Sequence[str] = (),
    outlines: FilePath | None = None,
    pixel_std: Annotated[float, Parameter(validator=validators.Number(gte=0.001))] = 0.5,
    at: str | None = None,
    write: Annotated[FilePath | None, Writes(kind="edited")] = None,
) -> "PointingResult":
    """Determine azimuth, zenith angle and roll of the camera, and the tilt of panels.

    Each source is weighted by its error; a source that contradicts the others is reported. --write puts the angles into
    the scene file as { value = ..., std = ... }, and the correlations of their errors into its [pointing], so that a
    comparison takes them into account.

    Example: rigctl calibrate pointing runs/panels --compass "171 +- 2" --declination "-11.3 +- 0.3"
    --level "-35,0.4 +- 0.3"

    Parameters
    ----------
    run : path or Run
        Run folder: time, site, size of the picture.
    lens : path
        Lens calibration, from `rigctl calibrate lens`.
    focal_px : str
        Focal length over pixel pitch with its error, without a lens file: "1500 +- 20".
    sun : str
        Position of the sun in the picture, pixels right and down: "X,Y".
    compass : str
        Magnetic azimuth of the viewing direction with its error [deg]: "171 +- 2".
    declination : str
        Magnetic declination, east positive, or with a letter: "-11.3 +- 0.3", "11.3 W +- 0.3".
    level : str
        Elevation (down is negative) and roll of the camera, with their error [deg]: "-35,0.4 +- 0.3".
    camera_at : str
        Place of the camera: "LATITUDE,LONGITUDE,HEIGHT +- METRES".
    target_at : str
        Place of the target, in the same form.
    panel : sequence of str
        A panel and its sides in metres: "white_panel=0.6x0.4". Repeatable.
    outlines : path
        Scene or regions file with the outlines of the panels.
    pixel_std : float
        Standard uncertainty of each coordinate of sun and corners [pixel].
    at : str
        Time of the picture with the sun; default: the middle of the run.
    write : path
        Scene file to update with the angles.
    """
    from calibration.pointing.pose import fuse, panel_tilt, sun_in_picture
    from rigctl.files.scene_file import write_into_scene
    from rigctl.runs.check import run_to_measure
    from rigctl.scene.pointing_sources import lens_of, panels_in_picture, pixel_of_sun, seen_sun, stated_sources

    record = run_to_measure(Path(run))

    def optics() -> "Lens":
        return lens_of(None if lens is None else Path(lens), focal_px, record)

    seen = None if sun is None else seen_sun(record, at_ns=time_option("--at", at), camera_at=camera_at)
    corners = None if outlines is None else Path(outlines)
    stands = panels_in_picture(panel, corners, pixel_std=pixel_std, lens=optics)
    sources = list(
        stated_sources(compass=compass, declination=declination, level=level, camera_at=camera_at, target_at=target_at)
    )
    if sun is not None and seen is not None:
        sources.append(sun_in_picture(pixel_of_sun(sun, record), pixel_std, seen, optics()))
    if not sources:
        raise ConfigError("no source gives the direction of the camera: give --compass, --level, --sun or another")
    pose = fuse(sources, None if lens is None and focal_px is None else optics().covariance)
    tilts = {name: [panel_tilt(one, pose) for one in found] for name, found in stands.items()}
    result = PointingResult(
        pose=pose,
        sources=tuple(one.name for one in sources),
        panels={name: rows[0] for name, rows in tilts.items() if len(rows) == 1},
        unclear={name: _both(rows) for name, rows in tilts.items() if len(rows) > 1},
        sun_deg=None if seen is None else (math.degrees(seen.azimuth_rad), math.degrees(seen.elevation_rad)),
    )
    for text in (*result.contradictions, *(f"{name}: {text}" for name, text in result.unclear.items())):
        warn(text)
    if write is None:
        return result
    changes = write_into_scene(Path(write), result.geometry, result.regions, result.pointing)
    for line in changes:
        note(line)
    return replace(result, changes=changes)


@dataclass(frozen=True, kw_only=True, eq=False)
class PointingResult(Result):
    """Direction of the camera, and tilt of panels."""

    pose: "CameraPose"
    sources: tuple[str, ...]  #: names of the sources
    panels: "Mapping[str, PanelTilt]"
    unclear: Mapping[str, str]  #: panels whose outline fits two tilts, with a text on both
    sun_deg: tuple[float, float] | None  #: azimuth and apparent elevation of the sun, if needed [deg]
    changes: tuple[str, ...] = ()  #: lines of the scene file that were removed and added

    def content(self) -> Iterable[Part]:
        """Return the angles with their errors, and correlations."""
        for name, numbers in {"geometry": self.geometry, **self.regions}.items():
            for key, (value, std) in numbers.items():
                yield f"{name}.{key:<20} {plus_minus(value, std)}"
        yield f"from {', '.join(self.sources)}"
        if self.sun_deg is not None:
            yield f"sun: azimuth {self.sun_deg[0]:.3f}, elevation {self.sun_deg[1]:.3f} deg"
        yield from _going_together(self.pointing)

    @property
    def geometry(self) -> dict[str, tuple[float, float]]:
        """Determined keys of a scene's ``[geometry]`` with value and standard uncertainty [deg]."""
        import numpy as np

        from calibration.pointing.pose import UNKNOWN_STD_RAD

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
    def joint(self) -> "tuple[tuple[str, ...], FloatArray]":
        """Parameters of the scene that are determined, and the covariance of their errors [deg^2].

        The angles of camera and panels depend on one another, so their errors are correlated.
        """
        import numpy as np

        from calibration.pointing.pose import joint_covariance

        names = ["geometry.camera_azimuth_deg", "geometry.camera_zenith_deg", "geometry.camera_roll_deg"]
        names += [f"regions.{name}.{key}" for name in self.panels for key in ("tilt_deg", "tilt_azimuth_deg")]
        found = {f"geometry.{key}" for key in self.geometry}
        found |= {f"regions.{name}.{key}" for name, numbers in self.regions.items() for key in numbers}
        kept = [k for k, name in enumerate(names) if name in found]
        covariance = np.degrees(1.0) ** 2 * joint_covariance(self.pose, tuple(self.panels.values()))
        return tuple(names[k] for k in kept), covariance[np.ix_(kept, kept)]

    @property
    def pointing(self) -> "PointingSection | None":
        """Correlations of the errors, as in a scene file; None if there are none."""
        import numpy as np

        from rigctl.files.place import PointingSection

        names, covariance = self.joint
        std = np.sqrt(np.diag(covariance))
        correlation = _FIRM * covariance / np.outer(std, std)
        np.fill_diagonal(correlation, 1.0)
        correlation = np.round(np.where(np.abs(correlation) > _NOT_NONE, correlation, 0.0), _DIGITS)
        kept = np.flatnonzero(np.sum(correlation != 0.0, axis=1) > 1)
        if not len(kept):
            return None
        return PointingSection(
            parameters=tuple(names[k] for k in kept),
            correlation=tuple(tuple(row) for row in correlation[np.ix_(kept, kept)].tolist()),
        )

    @property
    def regions(self) -> dict[str, dict[str, tuple[float, float]]]:
        """Keys of each panel's region with value and standard uncertainty [deg]."""
        return {name: _tilt_numbers(tilt) for name, tilt in self.panels.items()}

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Texts on sources that contradict the others."""
        return tuple(
            f"{_contradicts(one.name, self.sources)} (chi-square {one.chi_square:.1f}, p = {one.p_value:.1g}); all "
            "uncertainties are widened by that: look at it, or leave it out"
            for one in self.pose.contradictions
        )

    def as_json(self) -> dict[str, Json]:
        """Return angles, their covariance, sources and contradictions."""
        import numpy as np

        from rigctl.base.numbers import covariance_rows

        names = ("azimuth_deg", "elevation_deg", "roll_deg")
        numbers = zip(names, np.degrees(self.pose.angles_rad).tolist(), np.degrees(self.pose.std_rad), strict=True)
        return {
            "camera_looks": {name: {"value": value, "std": float(std)} for name, value, std in numbers},
            "covariance_deg2": covariance_rows(np.degrees(1.0) ** 2 * self.pose.covariance),
            "geometry": _as_numbers(self.geometry),
            "joint": {"parameters": list(self.joint[0]), "covariance_deg2": covariance_rows(self.joint[1])},
            "regions": {name: _as_numbers(numbers) for name, numbers in self.regions.items()},
            "unclear": dict(self.unclear),
            "sources": list(self.sources),
            "chi_square": self.pose.chi_square,
            "degrees_of_freedom": self.pose.freedom,
            "contradictions": list(self.contradictions),
            "sun_deg": None if self.sun_deg is None else list(self.sun_deg),
            "changes": list(self.changes),
        }


def _contradicts(name: str, sources: Sequence[str]) -> str:
    return f"{name} contradicts the other sources" if name in sources else f"{name} contradict one another"


def _as_numbers(numbers: Mapping[str, tuple[float, float]]) -> dict[str, Json]:
    return {key: {"value": value, "std": std} for key, (value, std) in numbers.items()}


def _tilt_numbers(tilt: "PanelTilt") -> dict[str, tuple[float, float]]:
    found = {"tilt_deg": (math.degrees(tilt.tilt_rad), math.degrees(tilt.tilt_std_rad))}
    if tilt.tilt_rad > _LEANS * tilt.tilt_std_rad:
        found["tilt_azimuth_deg"] = (math.degrees(tilt.azimuth_rad), math.degrees(tilt.azimuth_std_rad))
    return found


def _going_together(together: "PointingSection | None") -> Iterable[str]:
    """Yield texts on correlated errors, the strongest first."""
    if together is None:
        return
    rows = [
        (one, other, together.correlation[i][k])
        for i, one in enumerate(together.parameters)
        for k, other in enumerate(together.parameters[:i])
    ]
    for one, other, correlation in sorted(rows, key=lambda row: -abs(row[2]))[:_SHOWN]:
        if abs(correlation) >= _WORTH_A_LINE:
            yield f"errors of {other} and {one} are correlated: {correlation:+.2f}"


def _both(tilts: "Sequence[PanelTilt]") -> str:
    rows = (f"tilt {math.degrees(one.tilt_rad):.1f} toward {math.degrees(one.azimuth_rad):.0f} deg" for one in tilts)
    return " or ".join(rows) + ": the outline fits both; a larger picture or more accurate corners would decide"
