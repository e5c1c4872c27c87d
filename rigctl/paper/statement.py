"""A sentence of [MK14] with its check, the scenes that it is checked in, and readings of a sentence."""

from collections.abc import Callable
from dataclasses import dataclass

from rigctl.paper.airborne import Airborne, Geometry
from rigctl.paper.low_light import LowLight
from rigctl.paper.numbers import Reading, Test
from rigctl.paper.rooftop import Rooftop

HEIGHTS_M = (3000.0, 5000.0, 7000.0, 9000.0)
SUNS_DEG = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
VIEWS_DEG = (20.0, 40.0)
NOISE_FACTORS = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
ROC_NOISE_FACTORS = (1.0, 2.0, 3.0)
AZIMUTHS_DEG = (0.0, 90.0, 180.0)
# Of words for which the paper has no number.
MUCH, SIGNIFICANT = 1.5, 1.5
PATH_TURNED = "azimuth of the path radiance turned by 180 deg"
AS_STATED = "as stated"


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperScenes:
    """Scenes in which the statements are checked; `height_m` is that where the paper names none."""

    airborne: Airborne
    rooftop: Rooftop
    low_light: LowLight
    height_m: float = 3000.0

    def at(self, sun: float, view: float, phi: float = 180.0, kn: float = 1.0) -> Geometry:
        """Return a geometry of section V at the height that is taken where none is stated."""
        return Geometry(sun=sun, view=view, phi=phi, height_m=self.height_m, kn=kn)


@dataclass(frozen=True, kw_only=True)
class Statement:
    """A sentence and its check.

    Attributes
    ----------
    id, figure : str
        Its own name, and that of the figure.
    sentence : str
        The paper's words.
    geometry, check : str
        Where, and what is compared.
    readings : callable
        Scenes to the readings of the sentence.
    """

    id: str
    figure: str
    sentence: str
    geometry: str
    check: str
    readings: Callable[[PaperScenes], tuple[Reading, ...]]


def one_reading(*tests: Test) -> tuple[Reading, ...]:
    """Return the only reading that a sentence has."""
    return (Reading(name=AS_STATED, tests=tests),)


def both_azimuths(tests: Callable[[bool], tuple[Test, ...]]) -> tuple[Reading, ...]:
    """Return the readings with the azimuth of the path radiance as stated, and turned by 180 deg."""
    return (Reading(name=AS_STATED, tests=tests(False)), Reading(name=PATH_TURNED, tests=tests(True)))


def without_their_data(_: PaperScenes) -> tuple[Reading, ...]:
    """Return the reading of a sentence about measured points."""
    return (Reading(name="without their data", tests=()),)
