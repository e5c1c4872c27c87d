"""From mean counts to the level of the light: without what the camera counts in the dark, and per second."""

from dataclasses import dataclass, field

from rigctl.live.frame_summary import FrameSummary
from rigctl.live.live_status import DarkSource
from rigctl.live.mean_noise import MeanNoise


@dataclass(frozen=True, kw_only=True)
class Level:
    """Level of light that a mean stands for.

    Attributes
    ----------
    dn_per_s : float
        Counts a second of exposure, those of the dark taken off.
    variance : float or None
        What noise does to it [(DN/s)^2]; None without a calibration.
    """

    dn_per_s: float
    variance: float | None


@dataclass(kw_only=True)
class LightLevels:
    """Remembers the last dark frame of each exposure.

    Attributes
    ----------
    noise : MeanNoise or None
        From a calibration.
    """

    noise: MeanNoise | None = None
    _darks: dict[float, FrameSummary] = field(default_factory=dict)

    def add_dark(self, dark: FrameSummary) -> None:
        """Take in a dark frame."""
        self._darks[dark.exposure_s] = dark

    def source(self, exposure_s: float) -> DarkSource:
        """Return where the dark level at an exposure comes from."""
        if exposure_s in self._darks:
            return DarkSource.FRAMES
        return DarkSource.UNKNOWN if self.noise is None else DarkSource.CALIBRATION

    def dark_dn(self, region: str, exposure_s: float) -> float:
        """Return the mean count of a region without light [DN]; 0 where nothing is known of it."""
        dark = self._darks.get(exposure_s)
        if dark is not None:
            return dark.means[region].mean_dn
        return 0.0 if self.noise is None else self.noise.dark_dn(exposure_s)

    def level(self, frame: FrameSummary, region: str) -> Level:
        """Return the level of the light in a region of a frame."""
        mean, exposure_s = frame.means[region], frame.exposure_s
        variance_dn2 = (
            None
            if self.noise is None
            else self.noise.variance_dn2(mean.mean_dn, exposure_s=exposure_s, pixels=mean.pixels)
        )
        return Level(
            dn_per_s=(mean.mean_dn - self.dark_dn(region, exposure_s)) / exposure_s,
            variance=None if variance_dn2 is None else variance_dn2 / exposure_s**2,
        )
