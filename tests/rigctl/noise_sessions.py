"""Dark and flat frames on disk: a small sensor with known gain, as a run folder and as an EMVA 1288 data set."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rigctl.files.choices import FrameKind
from rigctl.runs.records import FrameRecord
from rigctl.runs.writer import RunWriter

GAIN_DN_PER_E = 0.25
READ_NOISE_E = 10.0
BLACK_LEVEL_DN = 60.0
SHAPE = (48, 64)
# Flats of 600 e- to beyond full scale (16 140 e-).
SIGNALS_E = (600.0, 2000.0, 4000.0, 6000.0, 8000.0, 10_000.0, 12_000.0, 14_000.0, 18_000.0)
# Kind of frame, and the share of the light that reaches it.
_KINDS: tuple[tuple[FrameKind, float], ...] = (("dark", 0.0), ("flat", 1.0))

Session = Iterator[tuple[FrameKind, float, NDArray[np.uint16]]]


def frames(seed: int = 1, black_level_dn: float = BLACK_LEVEL_DN) -> Session:
    """Kind, exposure and samples of two darks and two flats at each exposure, eight of each at one."""
    draws = np.random.default_rng(seed)
    response, offset_e = 1.0 + 0.01 * draws.standard_normal(SHAPE), 4.0 * draws.standard_normal(SHAPE)
    for light_e in SIGNALS_E:
        exposure_s = light_e / 1e6
        for _ in range(8 if light_e == 6000.0 else 2):
            for kind, photons in _KINDS:
                charge_e = (
                    draws.poisson(light_e * photons * response) + offset_e + READ_NOISE_E * draws.standard_normal(SHAPE)
                )
                counts = np.clip(np.rint(GAIN_DN_PER_E * charge_e + black_level_dn), 0, 4095).astype(np.uint16)
                yield kind, exposure_s, counts


def write_noise_run(path: Path, session: Session | None = None, *, gain_db: tuple[float, ...] = (0.0,)) -> Path:
    """Return a run folder of the frames; `gain_db` is gone through frame by frame."""
    with RunWriter.create(path, {"origin": "simulated"}) as writer:
        for sequence, (kind, exposure_s, counts) in enumerate(session or frames()):
            record = FrameRecord(
                kind=kind,
                sequence=sequence,
                bit_depth=12,
                saturation_dn=4095.0,
                exposure_s=exposure_s,
                gain_db=gain_db[sequence % len(gain_db)],
                polarizer_angle_target_deg=0.0 if kind == "flat" else None,
                polarizer_angle_deg=0.001 * (sequence % 3),
                camera_model="synthetic",
                camera_serial="42",
            )
            writer.write_frame(record, counts)
    return path


def write_emva_set(folder: Path, session: Session | None = None) -> Path:
    """Return the descriptor of an EMVA 1288 data set of the frames."""
    groups: dict[tuple[str, float], list[str]] = {}
    for number, (kind, exposure_s, counts) in enumerate(session or frames()):
        name = f"frame_{number}.png"
        cv2.imwrite(str(folder / name), counts)
        groups.setdefault((kind, exposure_s), []).append(name)
    lines = ["v 4.0", f"n 12 {SHAPE[1]} {SHAPE[0]}"]
    for (group_kind, exposure_s), names in groups.items():
        exposure_ns = round(exposure_s * 1e9)
        lines.append(f"d {exposure_ns}" if group_kind == "dark" else f"b {exposure_ns} {exposure_s * 2e6}")
        lines += [f"i {name}" for name in names]
    descriptor = folder / "set.txt"
    descriptor.write_text("\n".join(lines) + "\n")
    return descriptor
