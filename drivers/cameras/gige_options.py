"""Options of a GigE or USB3 Vision camera, as its address gives them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from drivers.cameras.bayer import PLANES, Plane
from drivers.cameras.camera_place import one_of, positive, split_place, whole, yes_or_no
from drivers.cameras.pixel_format import ByteOrder, Justified

Trigger = Literal["software", "free"]
Link = Literal["gige", "usb3", "any"]
"""How the camera is reached; "any" is whatever libaravis finds under a name."""


@dataclass(frozen=True, kw_only=True)
class GigeOptions:
    """Content of an address. None: the camera's largest picture, its best format, its own black level.

    Attributes
    ----------
    place : str
        IP address, serial number, or name.
    link : {"gige", "usb3", "any"}
        How it is reached.
    pixel_format : str or None
        As PFNC names it.
    plane : str or None
        What is taken of a Bayer format: see `drivers.cameras.bayer`.
    width, height : int or None
        Size of the region [pixels after binning].
    offset_x, offset_y : int
        Its first column and row.
    binning : int
        Pixels that are added, in both directions.
    reverse_x, reverse_y : bool
        The camera mirrors its pictures. A mirrored picture changes the sign of the angle of polarization: this is
        for undoing a mirror in the path of light.
    black_level_dn : int or None
        The camera's own black level setting.
    trigger : {"software", "free"}
        Each picture is asked for, or the camera runs by itself and pictures that began too early are thrown away.
    frame_rate_hz : float
        Where it runs by itself.
    packet_size : int, "probe" or None
        Bytes of a packet with all its headers; at most what the interface sends in one piece. "probe": the largest
        with which a whole picture comes.
    bandwidth_mb_per_s : float or None
        How much of the line the camera may take, where several share it [MB/s].
    bit_depth : int or None
        True bits of a sample where the format has room for more, as Mono16 has.
    justified, byte_order : str
        Where these bits stand, which byte comes first.
    exposure_step_us : float or None
        What a step of an exposure is that the camera counts without telling in what [us].
    gain_step_db : float or None
        What a step of the camera's whole-numbered gain is [dB], where its maker is not one that is known.
    ptp : bool or None
        Whether the camera's clock follows a PTP master; None: as it was found.
    retakes : int
        How often a damaged picture is taken again before that is an error.
    """

    place: str
    link: Link = "gige"
    pixel_format: str | None = None
    plane: Plane | None = None
    width: int | None = None
    height: int | None = None
    offset_x: int = 0
    offset_y: int = 0
    binning: int = 1
    reverse_x: bool = False
    reverse_y: bool = False
    black_level_dn: int | None = None
    trigger: Trigger = "software"
    frame_rate_hz: float = 20.0
    packet_size: int | Literal["probe"] | None = None
    bandwidth_mb_per_s: float | None = None
    bit_depth: int | None = None
    justified: Justified = "right"
    byte_order: ByteOrder = "little"
    exposure_step_us: float | None = None
    gain_step_db: float | None = None
    ptp: bool | None = None
    retakes: int = 20

    @property
    def camera_name(self) -> str:
        """What messages call it."""
        return f"{_NAMES[self.link]} {self.place}"


def _packet_size(text: str) -> int | str:
    return text if text == "probe" else whole(*_PACKET_BYTES)(text)


_PACKET_BYTES = (576, 16384)
_NAMES: dict[Link, str] = {"gige": "GigE camera", "usb3": "USB3 camera", "any": "camera"}
_READERS: dict[str, Callable[[str], Any]] = {
    "pixel_format": str,
    "plane": one_of(*PLANES),
    "width": whole(1, 65535),
    "height": whole(1, 65535),
    "offset_x": whole(0, 65535),
    "offset_y": whole(0, 65535),
    "binning": whole(1, 16),
    "reverse_x": yes_or_no,
    "reverse_y": yes_or_no,
    "black_level_dn": whole(0, 65535),
    "trigger": one_of("software", "free"),
    "frame_rate_hz": positive,
    "packet_size": _packet_size,
    "bandwidth_mb_per_s": positive,
    "bit_depth": whole(8, 16),
    "justified": one_of("right", "left"),
    "byte_order": one_of("little", "big"),
    "exposure_step_us": positive,
    "gain_step_db": positive,
    "ptp": yes_or_no,
    "retakes": whole(0, 1000),
}


def read_gige_place(text: str, *, link: Link = "gige") -> GigeOptions:
    """Return what ``PLACE?key=value&...`` says; see `GigeOptions` for the keys.

    Raises
    ------
    LimitError
        A key or value is not allowed; all are named.
    """
    place, values = split_place(text, _READERS)
    return GigeOptions(place=place, link=link, **values)
