"""A simulated session looked at before it is taken: whether camera and light can do what it asks."""

from collections.abc import Sequence

from rigctl.errors import ConfigError
from rigctl.files.regions import Region, masks
from rigctl.files.rig_file import RigFile
from rigctl.simulated.simulation import made_camera, seen_scene
from rigctl.simulated.stated_parts import frame_size


def rehearse(
    rig: RigFile, *, times_ns: Sequence[int], exposures_s: Sequence[float], regions: Sequence[Region]
) -> tuple[str, ...]:
    """Return in words under which sun each round of a simulated roof is seen, and where it is not that of its scene.

    Parameters
    ----------
    rig : RigFile
        With a [simulation].
    times_ns : sequence of int
        When rounds begin [ns since 1970 UTC].
    exposures_s : sequence of float
        Those that the session states [s].
    regions : sequence of Region
        Those that it watches.

    Raises
    ------
    ConfigError
        The simulation cannot be made, a region is outside the picture, or the roof has no light.
    LimitError
        The camera does not take an exposure, or the gain.
    """
    if rig.simulation is None:
        return ()
    try:
        seen = seen_scene(rig, utc_ns=lambda: times_ns[0])
        camera = made_camera(rig, seen, session_name="rehearsal")
    except ValueError as error:
        raise ConfigError(f"rig {rig.name}: the simulation cannot be made: {error}") from error
    for exposure_s in exposures_s:
        camera.configure(exposure_s=exposure_s, gain_db=rig.camera.gain_db)
    width, height = frame_size(rig, rig.simulation.camera)
    masks(list(regions), width=width, height=height)
    roof = seen.roof
    if roof is None:
        return ()
    for time_ns in times_ns:
        roof.require_day(time_ns)
    said = [] if roof.record.perturbed is None else [f"the roof is changed on purpose: {roof.record.perturbed}"]
    suns = dict.fromkeys(roof.sun_text(time_ns) for time_ns in (times_ns[0], times_ns[-1]))
    return (*roof.record.remarks, *said, *(f"sun: {text}" for text in suns))
