"""All that is written to a GigE Vision camera when it is opened, each thing read back, and what it then is."""

from dataclasses import dataclass, replace

from drivers.cameras.aravis_library import AravisLibrary
from drivers.cameras.bayer import Plane, size_of_counts
from drivers.cameras.gige_features import GigeFeatures
from drivers.cameras.gige_options import GigeOptions
from drivers.cameras.known_formats import GENICAM, polarized_format
from drivers.cameras.pixel_format import PixelFormat
from drivers.errors import LimitError
from drivers.network_path import path_mtu

_AUTOMATIC = ("ExposureAuto", "GainAuto", "BlackLevelAuto", "BalanceWhiteAuto", "ContrastAuto")
_PROCESSING = ("GammaEnable", "LUTEnable", "SharpnessEnable", "NoiseReductionEnable")
_GAMMA = "Gamma"
_EXPOSURE = ("ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw")
_EXPOSURE_RAW, _EXPOSURE_UNIT = "ExposureTimeRaw", "ExposureTimeBaseAbs"
# What some send behind their pixels.
_CHUNKS = "ChunkModeActive"
_GAIN, _GAIN_RAW = "Gain", "GainRaw"
# Makers whose GainRaw counts dB.
_RAW_IS_DB = ("prosilica", "allied", "avt", "aravis")
_BEST_FIRST = ("Mono14", "Mono12", "Mono12p", "Mono12Packed", "Mono10", "Mono10p", "Mono10Packed", "Mono16", "Mono8")
_RATE = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
_RATE_TOLERANCE = 0.01
_ETHERNET_MTU = 1500
# Where a camera limits what it takes of its line [bytes/s]: by the standard's name, or by Prosilica's.
_BANDWIDTH, _BANDWIDTH_MODE = ("DeviceLinkThroughputLimit", "StreamBytesPerSecond"), "DeviceLinkThroughputLimitMode"
_GIGABIT_NS_PER_BYTE, _PAUSE_TOLERANCE = 8.0, 0.05


@dataclass(frozen=True, kw_only=True)
class GigeSetup:
    """Settings of a camera that is set up.

    Attributes
    ----------
    pixel_format : PixelFormat
        Of its samples.
    pixel_format_code : int
        The number that each picture bears.
    sent_width, sent_height : int
        Size of the pictures that it sends.
    width, height, bit_depth : int
        Of counts: half as large, and of more bits, where several colours are summed.
    plane : str or None
        What is taken of a mosaic of colours.
    linear : bool or None
        What bends counts is off; None where the camera has nothing of that kind to be asked for.
    exposure_feature : str
        The camera's own name of the exposure.
    exposure_step_us : float
        What a step of it is [us]; 1 where it is in microseconds.
    gain_feature : str or None
        The camera's own name of the gain; None for a camera that has none.
    gain_step_db : float or None
        What a step of it is [dB]; None where it is in dB and need not be whole.
    """

    pixel_format: PixelFormat
    pixel_format_code: int
    sent_width: int
    sent_height: int
    width: int
    height: int
    bit_depth: int
    plane: Plane | None
    linear: bool | None
    exposure_feature: str
    exposure_step_us: float
    gain_feature: str | None
    gain_step_db: float | None


def set_up(features: GigeFeatures, options: GigeOptions) -> GigeSetup:
    """Write everything but exposure and gain; return what the camera then is.

    Raises
    ------
    LimitError
        The camera refuses a value, takes another one, or has something automatic that cannot be switched off.
    """
    linear = _switch_off(features)
    sent = _set_region(features, options)
    pixel_format, code = _set_pixel_format(features, options)
    if options.plane is not None or pixel_format.is_polarized:
        _refuse_moved_mosaic(options)
    width, height, bit_depth = size_of_counts(pixel_format, plane=options.plane, width=sent[0], height=sent[1])
    _set_black_level(features, options)
    _set_trigger(features, options)
    exposure_feature = features.first_of(*_EXPOSURE)
    if exposure_feature is None:
        raise LimitError(f"{options.place}: it has no exposure that is known ({', '.join(_EXPOSURE)})")
    gain_feature = features.first_of(_GAIN, _GAIN_RAW)
    return GigeSetup(
        pixel_format=pixel_format,
        pixel_format_code=code,
        sent_width=sent[0],
        sent_height=sent[1],
        width=width,
        height=height,
        bit_depth=bit_depth,
        plane=options.plane,
        linear=linear,
        exposure_feature=exposure_feature,
        exposure_step_us=_exposure_step_us(features, options) if exposure_feature == _EXPOSURE_RAW else 1.0,
        gain_feature=gain_feature,
        gain_step_db=_gain_step_db(features, options) if gain_feature == _GAIN_RAW else None,
    )


def set_packet_size(
    library: AravisLibrary, camera: int, features: GigeFeatures, *, address: str, asked: int | None
) -> int:
    """Set how large packets are: what was asked for, or what every Ethernet carries; return what it is [bytes].

    Raises
    ------
    LimitError
        More was asked for than the interface to the camera sends in one piece.
    """
    mtu = path_mtu(address)
    size = asked or min(mtu, _ETHERNET_MTU)
    if size > mtu:
        raise LimitError(
            f"{address}: packet_size is {size} bytes, and the interface to the camera carries {mtu}. Ask for less, or "
            " raise the MTU of the interface and of every switch between"
        )
    with features.told("packet size"):
        library.call("camera_gv_set_packet_size", camera, size)
        taken = int(library.call("camera_gv_get_packet_size", camera))
    features.used["GevSCPSPacketSize"] = str(taken)
    return taken


def set_bandwidth(
    library: AravisLibrary, camera: int, features: GigeFeatures, *, asked_mb_per_s: float, packet_size: int | None
) -> None:
    """Let the camera take a part of its line only, by a limit of its own, or by pauses between packets.

    Raises
    ------
    LimitError
        It has neither, or takes another value.
    """
    limit = features.first_of(*_BANDWIDTH)
    if limit is not None:
        if features.has(_BANDWIDTH_MODE):
            features.set_text(_BANDWIDTH_MODE, "On")
        features.set_whole(limit, round(asked_mb_per_s * 1e6))
        return
    if packet_size is None:
        raise LimitError(f"its bandwidth cannot be set ({', '.join(_BANDWIDTH)})")
    pause_ns = max(0, round(packet_size * 1e3 / asked_mb_per_s - packet_size * _GIGABIT_NS_PER_BYTE))
    with features.told("packet delay"):
        library.call("camera_gv_set_packet_delay", camera, pause_ns)
        taken_ns = int(library.call("camera_gv_get_packet_delay", camera))
    if abs(taken_ns - pause_ns) > _PAUSE_TOLERANCE * pause_ns:
        raise LimitError(
            f"its packets were to be {pause_ns} ns apart, for {asked_mb_per_s:g} MB/s, and are {taken_ns} ns apart: "
            "it cannot share its line, leave bandwidth_mb_per_s out"
        )
    features.used["GevSCPD"] = f"{taken_ns} ns"


def _switch_off(features: GigeFeatures) -> bool | None:
    """Switch off what changes pictures without being told to; return whether it had something that bends counts."""
    for feature in filter(features.has, _AUTOMATIC):
        features.set_text(feature, "Off")
    processing = [feature for feature in _PROCESSING if features.has(feature)]
    if features.has(_CHUNKS):
        features.set_truth(_CHUNKS, False)
    for feature in processing:
        features.set_truth(feature, False)
    if features.has(_GAMMA) and "GammaEnable" not in processing:
        features.set_number(_GAMMA, 1.0, relative=0.0)
        processing.append(_GAMMA)
    return True if processing else None


def _set_region(features: GigeFeatures, options: GigeOptions) -> tuple[int, int]:
    """Set binning, mirroring, size and place of the region; return width and height."""
    _set_or_need(features, "ReverseX", options.reverse_x, wanted=options.reverse_x)
    _set_or_need(features, "ReverseY", options.reverse_y, wanted=options.reverse_y)
    for feature in ("BinningHorizontal", "BinningVertical"):
        if features.has(feature):
            features.set_whole(feature, options.binning)
        elif options.binning != 1:
            raise LimitError(f"{options.place}: it cannot bin ({feature})")
    # A region can only grow while it begins at the corner.
    for feature in ("OffsetX", "OffsetY"):
        features.set_whole(feature, 0)
    size = [
        _set_length(features, "Width", options.width, options.offset_x),
        _set_length(features, "Height", options.height, options.offset_y),
    ]
    features.set_whole("OffsetX", options.offset_x)
    features.set_whole("OffsetY", options.offset_y)
    return size[0], size[1]


def _set_or_need(features: GigeFeatures, feature: str, value: bool, *, wanted: bool) -> None:
    if features.has(feature):
        features.set_truth(feature, value)
    elif wanted:
        raise LimitError(f"the camera cannot mirror its pictures ({feature})")


def _set_length(features: GigeFeatures, feature: str, asked: int | None, offset: int) -> int:
    _, most = features.whole_limits(feature)
    length = most - offset if asked is None else asked
    if length + offset > most:
        raise LimitError(f"{feature} {length} and offset {offset} are more than the camera has, {most}")
    features.set_whole(feature, length)
    return length


def _set_pixel_format(features: GigeFeatures, options: GigeOptions) -> tuple[PixelFormat, int]:
    offered = features.entries("PixelFormat")
    name = options.pixel_format or next((name for name in _BEST_FIRST if name in offered), None)
    if name is None or name not in offered:
        raise LimitError(f"{options.place}: pixel format {name}: the camera offers {', '.join(offered)}")
    features.set_text("PixelFormat", name)
    code = features.whole("PixelFormat") & 0xFFFFFFFF
    # Makers' own numbers are not known all, and their names say it.
    known = polarized_format(name) or GENICAM.get(code)
    if known is None:
        names = ", ".join(fmt.name for fmt in GENICAM.values())
        raise LimitError(f"{options.place}: pixel format {name} ({code:#010x}) cannot be read; known are {names}")
    depth = options.bit_depth or known.bit_depth
    if depth != known.bit_depth and known.bit_depth != 16:
        raise LimitError(f"{options.place}: bit_depth {depth}: samples of {name} have {known.bit_depth}")
    return replace(known, bit_depth=depth, justified=options.justified, byte_order=options.byte_order), code


def _refuse_moved_mosaic(options: GigeOptions) -> None:
    """Refuse what moves the mosaic's cell: what a camera then calls its format differs from maker to maker."""
    if options.offset_x % 2 or options.offset_y % 2 or options.reverse_x or options.reverse_y or options.binning != 1:
        raise LimitError(f"{options.place}: the cell of a mosaic needs even offsets, no mirroring and no binning")


def _set_black_level(features: GigeFeatures, options: GigeOptions) -> None:
    """Set the black level if asked to, and write down what it is."""
    feature = features.first_of("BlackLevelRaw", "BlackLevel")
    if options.black_level_dn is not None:
        if feature is None:
            raise LimitError(f"{options.place}: its black level cannot be set")
        if feature == "BlackLevelRaw":
            features.set_whole(feature, options.black_level_dn)
        else:
            features.set_number(feature, options.black_level_dn, relative=0.0)
    elif feature is not None:
        value = features.whole(feature) if feature == "BlackLevelRaw" else features.number(feature)
        features.used[feature] = f"{value} (as found)"


def _set_trigger(features: GigeFeatures, options: GigeOptions) -> None:
    features.set_text("AcquisitionMode", "Continuous")
    selectors = features.entries("TriggerSelector") if features.has("TriggerSelector") else []
    for selector in selectors:
        features.set_text("TriggerSelector", selector)
        features.set_text("TriggerMode", "Off")
    if "FrameStart" in selectors:
        features.set_text("TriggerSelector", "FrameStart")
    if options.trigger == "software":
        features.set_text("TriggerSource", "Software")
        features.set_text("TriggerMode", "On")
        return
    if features.has("AcquisitionFrameRateEnable"):
        features.set_truth("AcquisitionFrameRateEnable", True)
    rate = features.first_of(*_RATE)
    if rate is None:
        raise LimitError(f"{options.place}: its frame rate cannot be set ({', '.join(_RATE)}); use trigger=software")
    features.set_number(rate, options.frame_rate_hz, relative=_RATE_TOLERANCE)


def _exposure_step_us(features: GigeFeatures, options: GigeOptions) -> float:
    """Return what the camera counts its exposure in."""
    if options.exposure_step_us is not None:
        return options.exposure_step_us
    if features.has(_EXPOSURE_UNIT):
        return features.number(_EXPOSURE_UNIT)
    raise LimitError(
        f"{options.place}: it counts its exposure in steps ({_EXPOSURE_RAW}) and does not tell of what; state "
        "exposure_step_us=X in its address"
    )


def _gain_step_db(features: GigeFeatures, options: GigeOptions) -> float:
    if options.gain_step_db is not None:
        return options.gain_step_db
    maker = features.text("DeviceVendorName")
    if maker.lower().startswith(_RAW_IS_DB):
        return 1.0
    raise LimitError(
        f"{options.place}: nothing is known of what a step of GainRaw is for cameras of {maker}; state gain_step_db=X "
        "in its address"
    )
