"""What a page is shown of a run: frozen records, which become JSON as they are."""

from dataclasses import dataclass
from typing import Literal

Liveliness = Literal["waiting", "live", "holding", "stale", "finished", "stopped", "interrupted"]


@dataclass(frozen=True, kw_only=True)
class NewestFrame:
    """The newest frame behind one angle, or the newest dark or flat frame.

    Attributes
    ----------
    name : str
        "45", "dark", "flat": what to ask the picture by.
    sequence : int
        Its place in the run; a larger one is a newer picture.
    utc : str
        When its exposure began; empty where nobody knows.
    exposure_ms : float or None
        Integration time [ms].
    clipped : float
        Share of saturated pixels, 0 to 1.
    """

    name: str
    sequence: int
    utc: str
    exposure_ms: float | None
    clipped: float


@dataclass(frozen=True, kw_only=True)
class RegionCurve:
    """Polarization of a region, cycle by cycle; None where it is not known.

    Attributes
    ----------
    name : str
        "picture" is the whole.
    dolp, dolp_std : tuple of float or None
        And its standard deviation by the camera's noise; None without a calibration.
    aolp_deg, aolp_std_deg : tuple of float or None
        In [0, 180), and its standard deviation likewise [deg].
    light_dn_per_s : tuple of float or None
        S0 [DN/s].
    """

    name: str
    dolp: tuple[float | None, ...]
    dolp_std: tuple[float | None, ...]
    aolp_deg: tuple[float | None, ...]
    aolp_std_deg: tuple[float | None, ...]
    light_dn_per_s: tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class Curves:
    """What the cycles of a run show, one after the other.

    Attributes
    ----------
    time_s : tuple of float
        When each began, seconds since 1970 (UTC).
    sun_zenith_deg : tuple of float or None
        Zenith angle of the sun [deg].
    sum_rule : tuple of float or None
        (I0 + I90) / (I45 + I135) of the whole picture.
    drift_percent_per_min : tuple of float or None
        Of the light.
    regions : tuple of RegionCurve
        The picture and the session's regions.
    frames_read, frames_there : int
        How far the frames have been read: the curves grow with them.
    left_out : str
        Frames that people have excluded, and why: no curve has them. Empty where there are none.
    """

    time_s: tuple[float, ...] = ()
    sun_zenith_deg: tuple[float | None, ...] = ()
    sum_rule: tuple[float | None, ...] = ()
    drift_percent_per_min: tuple[float | None, ...] = ()
    regions: tuple[RegionCurve, ...] = ()
    frames_read: int = 0
    frames_there: int = 0
    left_out: str = ""


@dataclass(frozen=True, kw_only=True)
class Happening:
    """An event of the run, in words."""

    utc: str
    event: str
    facts: str


@dataclass(frozen=True, kw_only=True)
class CalibrationLook:
    """A calibration that lies beside a run.

    Attributes
    ----------
    file, kind : str
        Its name, and "noise", "flat", "polarizer", "radiometric" or "registration".
    made_utc : str
        When its frames were taken; empty where it does not say.
    valid_days : float or None
        For how long it holds [days].
    verdict : str
        "holds", "doubtful" or "does not hold", for this run.
    words : str
        Why; empty where it holds.
    """

    file: str
    kind: str
    made_utc: str = ""
    valid_days: float | None = None
    verdict: str
    words: str = ""


@dataclass(frozen=True, kw_only=True)
class RunLook:
    """A run as it stands now.

    Attributes
    ----------
    run : str
        Name of its folder.
    state : str
        "waiting" (there is nothing yet, or the next round has not begun), "live", "holding", "stale" (a process
        holds the run and has written nothing for long), "finished", "stopped" or "interrupted".
    since_utc : str
        Since when; empty where nobody knows.
    advice : str
        What to do; empty where there is nothing to do.
    session : str
        Its name.
    frames, frames_planned : int, int or None
        How many are durable, of how many.
    remaining_s : float or None
        What the session still takes [s].
    end_utc : str
        When it ends; empty where nobody knows.
    step : str
        The last frame in words: its kind, round, cycle and angle.
    sun_zenith_deg, sun_azimuth_deg, camera_temperature_c : float or None
        At the last frame.
    disk_free_mb : float
        What is free on the disk of the run [MB].
    is_simulated : bool
        No real device took part.
    newest : tuple of NewestFrame
        One for each angle of the last frames, by angle; then dark and flat.
    maps_of : str
        Which cycle the maps show; empty where there are none yet.
    events : tuple of Happening
        The last ones, the newest first.
    problems : tuple of str
        What cannot be read or is damaged.
    """

    run: str
    state: Liveliness
    since_utc: str = ""
    advice: str = ""
    session: str = ""
    frames: int = 0
    frames_planned: int | None = None
    remaining_s: float | None = None
    end_utc: str = ""
    step: str = ""
    sun_zenith_deg: float | None = None
    sun_azimuth_deg: float | None = None
    camera_temperature_c: float | None = None
    disk_free_mb: float = 0.0
    is_simulated: bool = False
    newest: tuple[NewestFrame, ...] = ()
    maps_of: str = ""
    events: tuple[Happening, ...] = ()
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RunRow:
    """A run in the list of a folder.

    Attributes
    ----------
    run : str
        Name of its folder: what its page is asked by.
    state : str
        As in `RunLook`.
    begun_utc : str
        When its folder was made.
    frames : int
        How many it holds.
    sun_zenith_deg : float or None
        At its first frame [deg].
    verdict : str
        Of the newest comparison beside it; empty where there is none.
    pages : tuple of str
        Summary and reports beside it: what they are asked by.
    """

    run: str
    state: Liveliness
    begun_utc: str
    frames: int
    sun_zenith_deg: float | None
    verdict: str = ""
    pages: tuple[str, ...] = ()
