"""A scene whose light changes: the texture of every pixel is drawn once, mean and spread are told anew."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_devices.scene_truth import refuse_no_covariance, refuse_unphysical

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionLight:
    """Light of a region's pixels at one moment.

    Attributes
    ----------
    mean
        Mean of (S0, S1, S2), shape (3,) [W m^-2 sr^-1 in band].
    cov
        Covariance over its pixels, shape (3, 3); it may be singular.
    """

    mean: FloatArray
    cov: FloatArray


class TexturedScene:
    """Regions before a background, each pixel with a texture of its own that stays while the light changes.

    Parameters
    ----------
    masks
        Region to where it is, boolean of shape (H, W); a later one covers an earlier one.
    background_radiance
        Unpolarised radiance where no region is [W m^-2 sr^-1], > 0.
    shape
        Height and width in pixels.
    generator
        Where texture comes from. The same state gives the same scene.
    """

    def __init__(
        self,
        *,
        masks: Mapping[str, NDArray[np.bool_]],
        background_radiance: float,
        shape: tuple[int, int],
        generator: np.random.Generator,
    ) -> None:
        self._background = np.zeros((3, *shape))
        self._background[0] = background_radiance
        self._masks = dict(masks)
        self._normals = {name: generator.standard_normal((3, int(mask.sum()))) for name, mask in self._masks.items()}

    @property
    def names(self) -> Sequence[str]:
        """Names of the regions, in the order in which they are painted."""
        return tuple(self._masks)

    def painted(self, lights: Mapping[str, RegionLight], *, background_share: float = 1.0) -> FloatArray:
        """Return the Stokes radiance of every pixel, shape (3, H, W) [W m^-2 sr^-1].

        Parameters
        ----------
        lights
            Of each region.
        background_share
            By what the background is multiplied, > 0.

        Raises
        ------
        ValueError
            A region has no light, a covariance is none, or a pixel has S0 <= 0 or DoLP > 1: its texture is too wide.

        Notes
        -----
        The symmetric root of the covariance makes pixels of their normal numbers: it is one and continuous, so that a
        slow change of the light moves every pixel slowly. In light whose parts keep their proportion, so do the pixels.
        """
        missing = sorted(set(self._masks).difference(lights))
        if missing:
            raise ValueError(f"no light is given of {', '.join(missing)}")
        radiance = background_share * self._background
        for name, mask in self._masks.items():
            light = lights[name]
            refuse_no_covariance(light.cov)
            radiance[:, mask] = light.mean[:, np.newaxis] + _symmetric_root(light.cov) @ self._normals[name]
        refuse_unphysical(radiance, name="a drawn pixel (make its texture smaller)")
        radiance.flags.writeable = False
        return radiance


def _symmetric_root(cov: FloatArray) -> FloatArray:
    variances, axes = np.linalg.eigh(cov)
    return np.asarray((axes * np.sqrt(np.maximum(variances, 0.0))) @ axes.T)
