"""Context of a session beside its steps: clocks, interlocks, who may interrupt it, where the sun is."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigctl.files.interlock_section import InterlockSection
from rigctl.files.rig_file import RigFile
from rigctl.files.session_file import PICTURE, MeteringSection, SessionFile
from rigctl.live.live_numbers import LiveNumbers
from rigctl.live.mean_noise import MeanNoise, mean_noise
from rigctl.live.region_means import RegionMeans
from rigctl.runs.session_record import SessionNoise
from rigctl.session.control import Control
from rigctl.session.planning.sun_track import SunTrack
from rigctl.session.session_clock import SessionClock, SteadyUtc

_S_PER_MIN = 60.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionContext:
    """Context of a session beside its steps.

    Attributes
    ----------
    interlocks, metering
        As in the session file.
    late_s : float
        A round that begins later than this after it was due is left out [s].
    until_ns : int or None
        No frame begins after this [ns since 1970 UTC].
    sun : SunTrack or None
        The sun above the site, where the site is known.
    clock : SessionClock
        The host's clocks.
    utc : SteadyUtc or None
        The time by which the session began; None begins now.
    control : Control
        What somebody asks for.
    noise : MeanNoise or None
        What noise does to means, from a calibration.
    regions : RegionMeans
        What is looked at in each frame.
    live : LiveNumbers
        Told of each frame, for whoever watches.
    metered_s : mapping
        Exposures that earlier parts of this session have metered, by round [s].
    asks_by_hold : bool
        Where hands are needed the session holds until it is told to go on; else it asks at the terminal.
    """

    interlocks: InterlockSection = field(default_factory=InterlockSection)
    metering: MeteringSection = field(default_factory=MeteringSection)
    late_s: float = 300.0
    until_ns: int | None = None
    sun: SunTrack | None = None
    clock: SessionClock = field(default_factory=SessionClock)
    utc: SteadyUtc | None = None
    control: Control = field(default_factory=Control)
    noise: MeanNoise | None = None
    regions: RegionMeans = field(default_factory=RegionMeans)
    live: LiveNumbers = field(default_factory=LiveNumbers)
    metered_s: Mapping[int, float] = field(default_factory=dict)
    asks_by_hold: bool = False


def session_context(
    session: SessionFile,
    rig_file: RigFile,
    *,
    clock: SessionClock,
    control: Control,
    until_ns: int | None,
    noise: SessionNoise | None,
    asks_by_hold: bool = False,
) -> SessionContext:
    """Return how a session file wants its session to be conducted, on a rig."""
    of_means = None if noise is None else mean_noise(noise)
    late_min = 5.0 if session.schedule is None else session.schedule.late_min
    return SessionContext(
        interlocks=session.interlocks,
        metering=session.metering,
        late_s=late_min * _S_PER_MIN,
        until_ns=until_ns,
        sun=None if rig_file.site is None else SunTrack(rig_file.site),
        clock=clock,
        utc=SteadyUtc(clock),
        control=control,
        noise=of_means,
        regions=RegionMeans(session.regions),
        live=LiveNumbers(
            noise=of_means,
            extinction_ratio=rig_file.polarizer.extinction_ratio,
            reference=session.reference_region or PICTURE,
        ),
        asks_by_hold=asks_by_hold,
    )
