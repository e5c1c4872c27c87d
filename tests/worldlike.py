"""Runs such as the world makes them, drawn at random with known faults: texture, blur, mosaics, tone curves.

A reading of reality of its own: it shares no formula with what judges the frames. Pictures are made by turning a real
polarizer over each pixel (Malus), walked and blurred in the Fourier plane, exposed photon by photon, and stored as
cameras and people store them.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, zoom

Pictures = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Faults:
    """What is wrong with a run; nothing at its defaults. Keys of dictionaries are numbers of frames."""

    throughput: dict[int, float] = field(default_factory=dict)
    angle_deg: dict[int, float] = field(default_factory=dict)
    dark_dn: dict[int, float] = field(default_factory=dict)
    shift_pixels: dict[int, tuple[float, float]] = field(default_factory=dict)
    tone: float = 1.0
    drift: float = 0.0
    clipped_share: float = 0.0
    border_pixels: int = 0
    left_shift: int = 0
    jpeg_quality: int | None = None


@dataclass(frozen=True, kw_only=True)
class World:
    """The scene and the camera of a run without faults.

    Attributes
    ----------
    angles_deg
        As the polarizer is said to stand.
    texture, texture_pixels
        Root mean square share of the light, and how coarse it is.
    blur_pixels
        Of the lens (standard deviation).
    is_demosaiced
        Each angle seen by one pixel in four, the others made from its neighbours.
    electrons
        At full scale.
    scene
        What the light is like: "objects", "grain" (texture of one size), or one of `SCENES`.
    polarized, is_evenly_polarized
        Share of the light that is polarized, where it is not drawn at random; the same everywhere, or object by object.
    resampled_deg
        All frames are turned by so much in the picture by who stored them, after their counts were whole.
    """

    angles_deg: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0)
    height: int = 160
    width: int = 192
    texture: float = 0.1
    texture_pixels: float = 1.5
    blur_pixels: float = 1.0
    is_demosaiced: bool = False
    full_scale_dn: int = 4095
    electrons: float = 20000.0
    read_noise_dn: float = 2.0
    black_dn: float = 0.0
    scene: str = "objects"
    polarized: float | None = None
    is_evenly_polarized: bool = False
    resampled_deg: float = 0.0


SCENES = ("power law", "checker", "steps", "gradient", "stars", "half flat", "stripes")
DESIGNS_DEG: tuple[tuple[float, ...], ...] = (
    (0.0, 45.0, 90.0, 135.0),
    tuple(30.0 * k for k in range(6)),
    tuple(22.5 * k for k in range(8)),
    tuple(45.0 * k for k in range(8)),
)


def other_world(rng: np.random.Generator, **fixed: Any) -> World:
    """Return a world of other kinds: scenes, designs, depths, small and narrow pictures, hardly or much polarized.

    None of it was looked at when the thresholds of the diagnosis were chosen.
    """
    bits = int(rng.choice([8, 10, 12, 14]))
    design = int(rng.integers(0, len(DESIGNS_DEG) + 1))
    angles = DESIGNS_DEG[design] if design < len(DESIGNS_DEG) else tuple(rng.uniform(0.0, 180.0, 12).round(2).tolist())
    height, width = ((64, 64), (40, 256), (128, 160), (96, 96))[int(rng.integers(0, 4))]
    drawn: dict[str, Any] = {
        "angles_deg": angles,
        "height": height,
        "width": width,
        "scene": str(rng.choice(SCENES)),
        "texture": float(np.exp(rng.uniform(np.log(0.02), np.log(0.4)))),
        "texture_pixels": float(rng.uniform(0.5, 6.0)),
        "blur_pixels": float(rng.uniform(0.0, 3.0)),
        "is_demosaiced": bool(rng.random() < 0.3),
        "full_scale_dn": 2**bits - 1,
        "electrons": float(np.exp(rng.uniform(np.log(4e3), np.log(1e5)))),
        "read_noise_dn": float(rng.uniform(0.3, 0.8) * 2 ** max(bits - 9, 0)),
        "polarized": float(rng.choice([0.9, 0.3, 0.05, 0.002])),
        "is_evenly_polarized": bool(rng.random() < 0.4),
        "resampled_deg": float(rng.choice([0.0, 0.0, rng.uniform(-5.0, 5.0)])),
    }
    return replace(World(**drawn), **fixed)


def random_world(rng: np.random.Generator, *, full_scale_dn: int | None = None, black_dn: float = 0.0) -> World:
    """Return a world of the ranges that other people's frames are of."""
    bits = int(rng.choice([8, 10, 12]))
    world = World(
        height=int(rng.integers(128, 224)),
        width=int(rng.integers(128, 256)),
        texture=float(np.exp(rng.uniform(np.log(0.02), np.log(0.4)))),
        texture_pixels=float(rng.uniform(0.7, 4.0)),
        blur_pixels=float(rng.uniform(0.0, 3.0)),
        is_demosaiced=bool(rng.random() < 0.3),
        full_scale_dn=2**bits - 1,
        electrons=float(np.exp(rng.uniform(np.log(4e3), np.log(6e4)))),
        read_noise_dn=float(rng.uniform(0.3, 0.8) * 2 ** max(bits - 9, 0)),
        black_dn=black_dn,
    )
    return world if full_scale_dn is None else replace(world, full_scale_dn=full_scale_dn)


def light(world: World, rng: np.random.Generator) -> tuple[Pictures, Pictures, Pictures]:
    """Return brightness (share of full scale), its polarized share and its angle [rad], of a wider picture."""
    if world.scene != "objects":
        return _other_light(world, rng)
    shape = (world.height + 64, world.width + 64)
    grain = gaussian_filter(rng.standard_normal(shape), world.texture_pixels, mode="wrap")
    grain += 0.7 * gaussian_filter(rng.standard_normal(shape), 4 * world.texture_pixels, mode="wrap") * 4
    bright = 0.45 * np.exp(0.25 * _smooth(rng, shape)) * np.clip(1 + world.texture * grain / grain.std(), 0.15, 2.0)
    share, axis = 0.25 + 0.12 * _smooth(rng, shape), 0.4 * _smooth(rng, shape) + rng.uniform(0, np.pi)
    for _ in range(int(rng.integers(3, 9))):
        where = _object(rng, shape)
        bright[where] *= rng.uniform(0.5, 1.3)
        share[where] = rng.uniform(0.0, 0.85)
        axis[where] = rng.uniform(0, np.pi)
    return np.clip(bright, 0.02, 0.85), np.clip(share, 0.0, 0.95), axis


def _other_light(world: World, rng: np.random.Generator) -> tuple[Pictures, Pictures, Pictures]:
    shape = (world.height + 64, world.width + 64)
    bright = 0.45 * np.clip(1.0 + world.texture * _pattern(world, rng, shape), 0.1, 1.9)
    share, axis = np.full(shape, 0.3 if world.polarized is None else world.polarized), np.full(shape, 0.0)
    axis += rng.uniform(0, np.pi)
    if not world.is_evenly_polarized:
        axis += 0.3 * _smooth(rng, shape)
        for _ in range(int(rng.integers(2, 7))):
            where = _object(rng, shape)
            share[where] *= rng.uniform(0.2, 1.0)
            axis[where] = rng.uniform(0, np.pi)
    return np.clip(bright, 0.005, 0.9), share, axis


def _pattern(world: World, rng: np.random.Generator, shape: tuple[int, int]) -> Pictures:
    """Return what varies over the picture, of unit size where it is not of isolated things."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    size = max(2.0, 4.0 * world.texture_pixels)
    if world.scene == "grain":
        grain = gaussian_filter(rng.standard_normal(shape), world.texture_pixels, mode="wrap")
        return grain * (2.0 * np.sqrt(np.pi) * world.texture_pixels)
    if world.scene == "checker":
        return np.where((rows // int(size) + columns // int(size)) % 2, 1.0, -1.0)
    if world.scene == "stripes":
        return np.sign(np.sin((rows * rng.normal() + columns * rng.normal()) / size))
    if world.scene == "steps":
        heights, across = rng.uniform(-1.6, 1.6, 6), (columns * 6) // shape[1]
        return np.where(rows > shape[0] * rng.uniform(0.3, 0.7), heights[across], -heights[across])
    if world.scene == "gradient":
        return 3.4 * (rows / shape[0] - 0.5) + 1.7 * (columns / shape[1] - 0.5)
    if world.scene == "stars":
        stars = np.zeros(shape)
        at = rng.integers(0, shape[0], 40), rng.integers(0, shape[1], 40)
        stars[at] = rng.exponential(1.0, 40)
        return gaussian_filter(stars, 1.5) * 14.0 / world.texture - 0.85 / world.texture
    down, across = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None, :]
    spectrum = np.hypot(down, across)
    spectrum[0, 0] = np.inf
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * spectrum ** -rng.uniform(0.5, 2.0), s=shape)
    field /= field.std()
    if world.scene == "half flat":
        field[:, : shape[1] // 2] = 0.0
    return field


def expose(
    world: World, faults: Faults, rng: np.random.Generator, noise: np.random.Generator | None = None
) -> NDArray[np.uint16]:
    """Return the frames of a run, one for each angle, shape (N, height, width); noise has its own draws where given."""
    bright, share, axis = light(world, rng)
    if faults.clipped_share > 0.0:
        bright = bright * 1.0 / np.quantile(bright * (1 + share) / 2, 1.0 - faults.clipped_share)
    frames = [
        _frame(index, world, faults, (bright, share, axis), noise or rng) for index in range(len(world.angles_deg))
    ]
    return np.array([_stored(frame, world, faults) for frame in frames])


def _frame(
    index: int, world: World, faults: Faults, scene: tuple[Pictures, Pictures, Pictures], rng: np.random.Generator
) -> Pictures:
    bright, share, axis = scene
    turned = np.radians(world.angles_deg[index] + faults.angle_deg.get(index, 0.0))
    passed = bright * (share * np.cos(axis - turned) ** 2 + (1.0 - share) / 2.0)
    passed *= (1.0 + faults.throughput.get(index, 0.0)) * (1.0 + faults.drift * index)
    walked = _walk_and_blur(passed, faults.shift_pixels.get(index, (0.0, 0.0)), world.blur_pixels)[32:-32, 32:-32]
    counts = rng.poisson(np.clip(walked, 0.0, None) * world.electrons) * (world.full_scale_dn / world.electrons)
    counts = counts + rng.normal(0.0, world.read_noise_dn, counts.shape)
    if world.is_demosaiced:
        counts = _demosaiced(counts, index)
    if faults.tone != 1.0:
        counts = world.full_scale_dn * np.clip(counts / world.full_scale_dn, 0.0, None) ** faults.tone
    return counts + world.black_dn + faults.dark_dn.get(index, 0.0)


def _stored(counts: Pictures, world: World, faults: Faults) -> NDArray[np.uint16]:
    kept = np.clip(np.rint(counts), 0, world.full_scale_dn).astype(np.uint16)
    if world.resampled_deg:
        turn = cv2.getRotationMatrix2D((kept.shape[1] / 2, kept.shape[0] / 2), world.resampled_deg, 1.0)
        kept = cv2.warpAffine(kept, turn, kept.shape[::-1], flags=cv2.INTER_LINEAR)
    if faults.jpeg_quality is not None:
        small = (kept * (255.0 / world.full_scale_dn)).round().astype(np.uint8)
        _, coded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, faults.jpeg_quality])
        decoded = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)
        kept = (decoded * (world.full_scale_dn / 255.0)).round().astype(np.uint16)
    if faults.border_pixels:
        edge = faults.border_pixels
        kept[:edge], kept[-edge:], kept[:, :edge], kept[:, -edge:] = 0, 0, 0, 0
    return (kept << faults.left_shift).astype(np.uint16)


def _smooth(rng: np.random.Generator, shape: tuple[int, int]) -> Pictures:
    coarse = rng.standard_normal((5, 6))
    return zoom(coarse, (shape[0] / 5, shape[1] / 6), order=3, mode="nearest")[: shape[0], : shape[1]]


def _object(rng: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.bool_]:
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    row, column = rng.uniform(0, shape[0]), rng.uniform(0, shape[1])
    tall, wide = rng.uniform(12, shape[0] / 3), rng.uniform(12, shape[1] / 3)
    if rng.random() < 0.5:
        return (np.abs(rows - row) < tall) & (np.abs(columns - column) < wide)
    return ((rows - row) / tall) ** 2 + ((columns - column) / wide) ** 2 < 1.0


def _walk_and_blur(picture: Pictures, shift: tuple[float, float], blur: float) -> Pictures:
    down, across = np.fft.fftfreq(picture.shape[0])[:, None], np.fft.rfftfreq(picture.shape[1])[None, :]
    # A lens passes nothing at the pixels' own limit, or the walk of a fraction of a pixel would ring.
    passed = np.exp(-2 * np.pi**2 * (blur**2 + 0.3**2) * (down**2 + across**2))
    turned = np.exp(-2j * np.pi * (across * shift[0] + down * shift[1]))
    return np.fft.irfft2(np.fft.rfft2(picture) * passed * turned, s=picture.shape)


def _demosaiced(counts: Pictures, index: int) -> Pictures:
    row, column = divmod(index % 4, 2)
    mine = np.zeros_like(counts)
    mine[row::2, column::2] = 1.0
    kernel = np.outer([0.5, 1.0, 0.5], [0.5, 1.0, 0.5])
    return cv2.filter2D(counts * mine, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
