"""The light of a simulated roof, as its run keeps it: what lit it, what was changed, and what that proves."""

from dataclasses import dataclass

PROVES = (
    "a simulated roof: the light of {scene} was computed by the same model that predicts it. What this run can show is "
    "that processing, sensor and the chain of the program are right: stage, angles, darks, calibration, Stokes "
    "parameters, statistics and verdict. It cannot show that the scene model (surfaces, sky, sun, air) is right of "
    "nature: that needs real frames"
)


@dataclass(frozen=True, kw_only=True)
class SimulatedLight:
    """The light of a simulated roof.

    Attributes
    ----------
    scene : str
        Name of the scene that it was computed from.
    is_clocked : bool
        The sun was that of the run's simulated clock at its site; otherwise that which the scene file states.
    sun_zenith_deg, sun_azimuth_deg : float or None
        That stated sun [deg]; None where the clock moves it, or the file states no azimuth.
    distance_factor : float or None
        Its irradiance over that at the mean distance.
    perturbed : str or None
        What was changed against the scene file, in words.
    remarks : tuple of str
        Where place and time of the scene file are not those of the run.
    """

    scene: str
    is_clocked: bool
    sun_zenith_deg: float | None = None
    sun_azimuth_deg: float | None = None
    distance_factor: float | None = None
    perturbed: str | None = None
    remarks: tuple[str, ...] = ()

    @property
    def caution(self) -> tuple[str, ...]:
        """What a report of such a run has to say, in words."""
        proves = PROVES.format(scene=self.scene)
        if self.perturbed is None:
            return (proves,)
        return (proves, f"the simulated roof was changed on purpose: {self.perturbed}")
