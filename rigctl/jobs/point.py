"""Where camera and panels point: what a person has measured and what pictures show in; angles with errors out."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.pointing.pose import (
    UNKNOWN_STD_RAD,
    CameraPose,
    PanelStand,
    PanelTilt,
    PoseSource,
    fuse,
    joint_covariance,
    level_panel,
    panel_tilt,
)
from rigctl.console.json_text import Json
from rigctl.errors import ConfigError
from rigctl.files.place import PointingSection
from rigctl.files.scene_file import write_into_scene
from rigctl.jobs.point_request import (
    PointRequest,
    lens_of,
    level_panels,
    panels_in_picture,
    seen_sun,
    stated_sources,
)
from rigctl.runs.check import used_run

FloatArray = NDArray[np.float64]

# A panel that is tilted by less than this many of its errors leans nowhere.
_LEANS = 3.0
# Less is rounding. What is written stays a correlation when its last digits are rounded.
_NOT_NONE, _FIRM, _DIGITS = 1e-6, 1.0 - 1e-8, 10


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
    def joint(self) -> tuple[tuple[str, ...], FloatArray]:
        """Parameters of the scene that are determined, and the covariance of their errors [deg^2].

        The camera's angles and the panels' are found from one another, so their errors go together.
        """
        names = ["geometry.camera_azimuth_deg", "geometry.camera_zenith_deg", "geometry.camera_roll_deg"]
        names += [f"regions.{name}.{key}" for name in self.panels for key in ("tilt_deg", "tilt_azimuth_deg")]
        found = {f"geometry.{key}" for key in self.geometry}
        found |= {f"regions.{name}.{key}" for name, numbers in self.regions.items() for key in numbers}
        kept = [k for k, name in enumerate(names) if name in found]
        covariance = np.degrees(1.0) ** 2 * joint_covariance(self.pose, tuple(self.panels.values()))
        return tuple(names[k] for k in kept), covariance[np.ix_(kept, kept)]

    @property
    def pointing(self) -> PointingSection | None:
        """How the errors go together, as a scene file has it; None where each is on its own."""
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
        """Which sources the others exclude, in words."""
        return tuple(
            f"{_contradicts(one.name, self.sources)} (chi-square {one.chi_square:.1f}, p = {one.p_value:.1g}); all "
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
            "joint": {"parameters": list(self.joint[0]), "covariance_deg2": self.joint[1].tolist()},
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
    sun = seen_sun(request, run) if request.sun or request.shadow else None
    stands = panels_in_picture(request, run)
    stated = list(stated_sources(request, run, sun))
    levels = level_panels(request.level_panels)
    missing = [name for name in levels if name not in stands]
    if missing:
        raise ConfigError(f"--level-panel: {', '.join(missing)}: give its size too, --panel {missing[0]}=0.6x0.4")
    if not stated and not levels:
        raise ConfigError("nothing says where the camera looks: give --compass, --level, --sun, --shadow or another")
    lens = None if request.lens is None and request.focal_px is None else lens_of(request, run).covariance
    tries = itertools.product(*(stands[name] for name in levels))
    chosen = [_with_panels(stated, levels, lying) for lying in tries]
    pose, sources = min(((fuse(one, lens), one) for one in chosen), key=lambda found: found[0].chi_square)
    tilts = {name: [panel_tilt(one, pose) for one in found] for name, found in stands.items() if name not in levels}
    found = Pointed(
        pose=pose,
        sources=tuple(one.name for one in sources),
        panels={name: rows[0] for name, rows in tilts.items() if len(rows) == 1},
        unclear={name: _both(rows) for name, rows in tilts.items() if len(rows) > 1},
        sun_deg=None if sun is None else (float(np.degrees(sun.azimuth_rad)), float(np.degrees(sun.elevation_rad))),
    )
    if request.write is None:
        return found
    return replace(found, changes=write_into_scene(request.write, found.geometry, found.regions, found.pointing))


def _with_panels(
    stated: Sequence[PoseSource], levels: Mapping[str, float], lying: Sequence[PanelStand]
) -> list[PoseSource]:
    panels = zip(levels.items(), lying, strict=True)
    return [*stated, *(level_panel(name, stand, float(np.radians(std))) for (name, std), stand in panels)]


def _both(tilts: Sequence[PanelTilt]) -> str:
    rows = (f"tilt {np.degrees(one.tilt_rad):.1f} toward {np.degrees(one.azimuth_rad):.0f} deg" for one in tilts)
    return " or ".join(rows) + ": the outline fits both; a larger picture of it, or its corners better, would tell"
