"""Effects of the rendering, and what each is told of the frame that it acts on."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim_devices.random_streams import Stream, generator

FloatArray = NDArray[np.float64]

# Where in the chain an effect acts: on expected photo-electrons before the pixels' response, on what a pixel is
# expected to hold, on the electrons that were drawn, on what is added when a pixel is read.
Place = Literal["light", "expected charge", "charge", "read-out"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One frame, as far as an effect has to know it.

    Attributes
    ----------
    noise
        Shot noise and read noise draw from it, in this order.
    noise_seed, sequence
        With the stream they decide what every other effect draws, whatever was taken before.
    exposure_s
        Integration time.
    axis_deg
        Where the polarizer's axis points, over whole turns, counter-clockwise from horizontal.
    """

    noise: np.random.Generator
    noise_seed: int
    sequence: int
    exposure_s: float
    axis_deg: float

    def draws(self, stream: Stream) -> np.random.Generator:
        """Return the random numbers of one effect for this frame."""
        return generator(self.noise_seed, stream, self.sequence)


# Takes the picture so far, shape (H, W) [e-], and returns the next one; it may change its argument in place.
Act = Callable[[FloatArray, Shot], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderingEffect:
    """An effect that a rig file names.

    Attributes
    ----------
    name
        As the rig file calls it.
    place
        Where it acts; effects of one place act in the order of the list.
    act
        What it does.
    """

    name: str
    place: Place
    act: Act


def refuse_outside(name: str, value: float, *, least: float, most: float = np.inf) -> None:
    """Raise ValueError unless `value` is finite and within least .. most."""
    if not (least <= value <= most and np.isfinite(value)):
        raise ValueError(f"{name} is {value}; it has to be finite, at least {least:g} and at most {most:g}")
