"""The tables of a scene file that describe an aerosol of one's own: spheres by their sizes and indices."""

from math import inf, log
from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from model.atmosphere.mie import (
    LogNormal,
    MieAerosol,
    ParticleMode,
    RefractiveIndex,
    SizeDistribution,
    TabulatedSizes,
    log_normal,
    number_of_volume,
)
from rigctl.files.config import Section

NM_PER_M = 1e9
UM_PER_M = 1e6

Number = Annotated[float, Field(strict=True)]
Above0 = Annotated[Number, Field(gt=0)]


def _listed(given: object) -> object:
    return given if isinstance(given, list) else [given]


OneOrMore = Annotated[list[Number], BeforeValidator(_listed), Field(min_length=1)]


class ModeSection(Section):
    """Particles of one substance with one law of size.

    The law is log-normal, by the median radius of the number or of the volume and the deviation of the natural or the
    decimal logarithm; or a table of the number per ln(radius). `number_share` counts particles, `volume_share` their
    volume; shares of several modes count relative to each other. n and k are plain numbers, or lists over
    `wavelength_nm`.
    """

    number_share: Above0 | None = None
    """Share of the particles, relative to the other modes. Example: `0.9`."""
    volume_share: Above0 | None = None
    """Share of the volume, relative to the other modes. Example: `0.5`."""
    number_median_radius_um: Above0 | None = None
    """Median radius of the number. Example: `0.03`."""
    volume_median_radius_um: Above0 | None = None
    """Median radius of the volume. Example: `0.2`."""
    ln_sigma: Above0 | None = None
    """Deviation of the radius' natural logarithm. Example: `0.8`."""
    log10_sigma: Above0 | None = None
    """Deviation of the radius' decimal logarithm. Example: `0.35`."""
    largest_radius_um: Above0 | None = None
    """Where the law is cut. Example: `20.0`."""
    radius_um: list[Number] | None = None
    """Radii of a table of sizes, in place of a law. Example: `[0.01, 0.1, 1.0]`."""
    number_per_log_radius: list[Number] | None = None
    """Number per ln(radius) at each radius. Example: `[1.0, 0.5, 0.001]`."""
    n: OneOrMore
    """Real part of the refractive index, or one for each wavelength. Example: `1.45`."""
    k: OneOrMore
    """Imaginary part of the refractive index, or one for each wavelength. Example: `0.005`."""
    wavelength_nm: tuple[Number, ...] = ()
    """Wavelengths of n and k, where these are lists. Example: `[400.0, 700.0]`."""

    @model_validator(mode="after")
    def _possible(self) -> "ModeSection":
        if self.number_share is not None and self.volume_share is not None:
            raise ValueError("needs one of number_share and volume_share, not both")
        self._require_one_law()
        if self.volume_share is not None and self.volume_median_radius_um is None:
            raise ValueError("volume_share needs volume_median_radius_um")
        self.mode()
        return self

    def mode(self) -> ParticleMode:
        """Return the mode as the model takes it.

        Raises
        ------
        ValueError
            A number is outside its range.
        """
        index = RefractiveIndex(
            n=tuple(self.n), k=tuple(self.k), wavelength_m=tuple(nm / NM_PER_M for nm in self.wavelength_nm)
        )
        return ParticleMode(number_share=self._share(), sizes=self._sizes(), index=index)

    def _require_one_law(self) -> None:
        table = (self.radius_um, self.number_per_log_radius)
        if None not in table and self._log_normal_keys() == []:
            return
        if table != (None, None):
            raise ValueError(
                "a table of sizes needs radius_um and number_per_log_radius, and no median, sigma or largest"
            )
        if (self.number_median_radius_um is None) == (self.volume_median_radius_um is None):
            raise ValueError("needs exactly one of number_median_radius_um and volume_median_radius_um, or a table")
        if (self.ln_sigma is None) == (self.log10_sigma is None):
            raise ValueError("needs exactly one of ln_sigma and log10_sigma")

    def _log_normal_keys(self) -> list[str]:
        names = (
            "number_median_radius_um",
            "volume_median_radius_um",
            "ln_sigma",
            "log10_sigma",
            "largest_radius_um",
        )
        return [name for name in names if getattr(self, name) is not None]

    def _sizes(self) -> SizeDistribution:
        if self.radius_um is not None and self.number_per_log_radius is not None:
            return TabulatedSizes(
                radius_m=tuple(um / UM_PER_M for um in self.radius_um),
                number_per_log_radius_at=tuple(self.number_per_log_radius),
            )
        return self._log_normal()

    def _log_normal(self) -> LogNormal:
        return log_normal(
            number_median_radius_m=_metres(self.number_median_radius_um),
            volume_median_radius_m=_metres(self.volume_median_radius_um),
            ln_sigma=self.ln_sigma,
            log10_sigma=self.log10_sigma,
            largest_radius_m=inf if self.largest_radius_um is None else self.largest_radius_um / UM_PER_M,
        )

    def _share(self) -> float:
        if self.volume_share is None or self.volume_median_radius_um is None:
            return 1.0 if self.number_share is None else self.number_share
        ln_sigma = self.ln_sigma if self.ln_sigma is not None else log(10.0) * (self.log10_sigma or 0.0)
        # Only the ratio of two modes counts: micrometres keep the numbers near 1.
        return number_of_volume(
            volume=self.volume_share, volume_median_radius_m=self.volume_median_radius_um, ln_sigma=ln_sigma
        )


class OwnAerosolSection(Section):
    """Spheres of one's own: what to call them, where their numbers come from, and their modes."""

    name: Annotated[str, Field(pattern=r"\S")] = "own"
    """What to call it. Example: `"smoke"`."""
    source: Annotated[str, Field(pattern=r"\S")] = "no source given"
    """Where its numbers are from. Example: `"AERONET, 2026-05-04"`."""
    modes: Annotated[list[ModeSection], Field(min_length=1)]
    """Its modes of particles."""

    @model_validator(mode="after")
    def _one_kind_of_share(self) -> "OwnAerosolSection":
        given = {(mode.number_share is not None, mode.volume_share is not None) for mode in self.modes}
        if len(given) > 1:
            raise ValueError("modes: all need number_share, or all volume_share")
        if len(self.modes) > 1 and given == {(False, False)}:
            raise ValueError("modes: several need number_share or volume_share")
        return self

    def aerosol(self) -> MieAerosol:
        """Return the aerosol as the model takes it."""
        return MieAerosol(name=self.name, modes=tuple(mode.mode() for mode in self.modes), source=self.source)


def _metres(micrometres: float | None) -> float | None:
    return None if micrometres is None else micrometres / UM_PER_M
