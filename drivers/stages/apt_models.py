"""Known Thorlabs rotation stages with an APT controller, and how they count.

Sources: Thorlabs, "APT Host-Controller Communications Protocol", issue 25, section on scaling; parameters of the K10CR1
as its maker's program sets them.
"""

from dataclasses import dataclass

from drivers.errors import ProtocolError

PRM1_STAGE_ID = 6
_T_S = 2048.0 / 6e6  # sampling interval of a K-Cube DC servo


@dataclass(frozen=True, kw_only=True)
class VelocityParameters:
    """Speed and acceleration of moves, in the controller's units."""

    lowest: int
    acceleration: int
    highest: int


@dataclass(frozen=True, kw_only=True)
class HomeParameters:
    """Search of the reference mark, in the controller's units; direction 2 and switch 1 are "reverse"."""

    direction: int
    switch: int
    velocity: int
    offset_counts: int


@dataclass(frozen=True, kw_only=True)
class AptModel:
    """A controller with its stage.

    Attributes
    ----------
    name : str
        What people call the two.
    is_stepper : bool
        Whether it speaks the messages of stepper motors, else those of DC servo motors.
    counts_per_deg : float
        Counts of a degree.
    speed_deg_per_s : float
        What moves and homing are set to.
    velocity : VelocityParameters
        Set at every start, since some controllers forget theirs at power-off.
    home : HomeParameters
        Likewise.
    """

    name: str
    is_stepper: bool
    counts_per_deg: float
    speed_deg_per_s: float
    velocity: VelocityParameters
    home: HomeParameters


def _k10cr(name: str) -> AptModel:
    return AptModel(
        name=name,
        is_stepper=True,
        counts_per_deg=409600.0 / 3.0,
        speed_deg_per_s=10.0,
        velocity=VelocityParameters(lowest=0, acceleration=15020, highest=73300775),
        home=HomeParameters(direction=2, switch=1, velocity=73300775, offset_counts=546133),
    )


def _prm1(controller: str) -> AptModel:
    counts_per_deg, speed_deg_per_s, acceleration_deg_per_s2 = 1919.6418578623391, 10.0, 10.0
    velocity = round(speed_deg_per_s * counts_per_deg * _T_S * 65536.0)
    acceleration = round(acceleration_deg_per_s2 * counts_per_deg * _T_S**2 * 65536.0)
    return AptModel(
        name=f"{controller} with PRM1-Z8",
        is_stepper=False,
        counts_per_deg=counts_per_deg,
        speed_deg_per_s=speed_deg_per_s,
        velocity=VelocityParameters(lowest=0, acceleration=acceleration, highest=velocity),
        home=HomeParameters(direction=2, switch=1, velocity=velocity, offset_counts=0),
    )


_BUILT_IN = {"K10CR1": _k10cr("K10CR1"), "K10CR2": _k10cr("K10CR2")}
_DC_CONTROLLERS = ("KDC101", "TDC001")


def find_model(controller: str, *, stage_id: int, actuator: str | None) -> AptModel:
    """Return the model that a controller and its stage are.

    Parameters
    ----------
    controller : str
        What the controller calls itself, such as "K10CR1".
    stage_id : int
        What it says of the stage that is plugged into it.
    actuator : str or None
        "PRM1-Z8" where the person at the rig says so, since the controller does not.

    Raises
    ------
    ProtocolError
        It is none of the known ones: its counts would be a guess, and every angle with them.
    """
    if controller in _BUILT_IN:
        return _BUILT_IN[controller]
    if controller in _DC_CONTROLLERS and (stage_id == PRM1_STAGE_ID or actuator == "PRM1-Z8"):
        return _prm1(controller)
    known = ", ".join([*_BUILT_IN, *(f"{name} with PRM1-Z8" for name in _DC_CONTROLLERS)])
    raise ProtocolError(
        f"controller {controller!r} with a stage of number {stage_id} is none of {known}. If a PRM1-Z8 is plugged "
        'in and the controller does not say so: actuator = "PRM1-Z8"'
    )
