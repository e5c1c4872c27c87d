"""Finds video devices, and the format in which each is best read."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from drivers.cameras import v4l2_structs as v4l2
from drivers.cameras.known_formats import V4L2
from drivers.cameras.v4l2_node import LinuxVideoNode, VideoNode, told
from drivers.errors import DeviceError
from drivers.interfaces import DeviceIdentity

_DEVICES = Path("/dev")
_PATTERN = "video*"
# Most bits first, but for formats that pad fewer bits to 16 and do not tell how many.
_BEST_FIRST = ("Y14 ", "Y12 ", "Y12P", "Y10 ", "Y10P", "Y16 ", "GREY")
_MOST_FORMATS = 100


def find_v4l2(
    paths: Iterable[str] | None = None, *, open_node: Callable[[str], VideoNode] = LinuxVideoNode
) -> Iterator[tuple[str, DeviceIdentity]]:
    """Give address and identity of each video device that takes pictures; nothing is set.

    Parameters
    ----------
    paths : iterable of str, optional
        Device files; None: all of /dev/video*.
    open_node : callable
        Opens one.

    Raises
    ------
    DeviceError
        A device cannot be asked; the others are given first.
    """
    failure: DeviceError | None = None
    for path in sorted(map(str, _DEVICES.glob(_PATTERN))) if paths is None else paths:
        try:
            node = open_node(path)
            try:
                found = _asked(node)
            finally:
                node.close()
        except DeviceError as error:
            failure = error
            continue
        if found is not None:
            yield found
    if failure is not None:
        raise failure


def _asked(node: VideoNode) -> tuple[str, DeviceIdentity] | None:
    """Return a device's address and identity; None if it takes no pictures."""
    capability = v4l2.Capability()
    try:
        node.request(v4l2.QUERYCAP, capability)
    except OSError as error:
        raise told(error, path=node.path, what="asking what it is") from error
    if not v4l2.can_take_pictures(capability):
        return None
    offered = _formats(node)
    best = next((letters for letters in (*_BEST_FIRST, *V4L2) if letters in offered), None)
    model = capability.card.decode(errors="replace")
    address = f"v4l2:{node.path}"
    if best is None:
        model += f" (sends finished pictures only, {', '.join(map(str.strip, offered))}: no counts to measure with)"
    else:
        address += f"?pixel_format={best.strip()}" + ("" if V4L2[best].cell is None else "&plane=green-1")
    identity = DeviceIdentity(
        model=model,
        serial_number=capability.bus_info.decode(errors="replace"),
        firmware=capability.driver.decode(errors="replace"),
    )
    return address, identity


def _formats(node: VideoNode) -> list[str]:
    """Return the formats of a device by their four letters."""
    offered = []
    for index in range(_MOST_FORMATS):
        description = v4l2.FormatDescription(index=index, type=v4l2.CAPTURE)
        try:
            node.request(v4l2.ENUM_FMT, description)
        except OSError:
            break  # there are no more: this request has no other way to say so
        offered.append(v4l2.letters_of(description.pixelformat))
    return offered
