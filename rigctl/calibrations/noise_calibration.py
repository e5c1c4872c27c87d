"""Makes a noise calibration from frames (`calibrate_frames`), and the content of its file, ``noise.json``.

Levels are measured in threads, a few at a time, so that memory is bounded.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace

import numpy as np

from calibration.estimate import Bound, Estimate
from calibration.results import CalibrationError, Flag, RefusedFramesError, by_consequence
from calibration.sensor.curves import PhotonTransfer, brighter_fatter
from calibration.sensor.emva1288 import EMVA_SYMBOLS, EmvaFigure
from calibration.sensor.levels import LevelStatistics, level_statistics
from calibration.sensor.noise import NoiseCalibration, calibrate_noise, first_lines, not_known, with_pattern
from calibration.sensor.pattern import Defect, FixedPattern, PatternHistogram, Spectrogram, fixed_pattern
from rigctl.base.numbers import covariance_rows, utc_text
from rigctl.calibrations.noise import QUANTITIES, SCHEMA_VERSION
from rigctl.calibrations.noise_frames import FrameGroup, FrameSet
from rigctl.console import Json
from rigctl.errors import DataError
from rigctl.version import VERSION

# Length of the list of defects; the map has all.
_LISTED = 1000


def noise_content(calibration: NoiseCalibration, frames: FrameSet, *, created_ns: int) -> dict[str, Json]:
    """Return the content of the file, made at a time [ns since 1970 UTC]."""
    estimates = {name: getattr(calibration, name) for name in QUANTITIES}
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "noise",
        "created_by": f"rigctl {VERSION}",
        "created_utc": utc_text(created_ns),
        "source": asdict(frames.source),
        "made_for": frames.made_for.as_json(),
        **{name: _estimate(found, calibration.bounds.get(name)) for name, found in estimates.items()},
        "covariance": {
            "names": list(calibration.covariance.names),
            "matrix": covariance_rows(calibration.covariance.matrix),
        },
        "flags": [asdict(flag) for flag in calibration.flags],
        "performance": asdict(calibration.performance),
        "dark_levels": _dark_levels(calibration),
        "photon_transfer": _curve(calibration.transfer),
        "linearity": _linearity(calibration.transfer),
        "emva1288": {name: _standard(name, figure) for name, figure in calibration.emva1288.items()},
        "read_first": list(first_lines(calibration)),
        "not_known": not_known(calibration),
        "influence": [asdict(one) for one in calibration.influence],
        "light_stability": asdict(calibration.light_stability),
        "fixed_pattern": None if calibration.pattern is None else _pattern(calibration.pattern),
    }


def _estimate(found: Estimate | None, bound: Bound | None) -> dict[str, Json] | None:
    """Return a number, its bound where only that is known, or None."""
    if found is not None:
        return asdict(found)
    return None if bound is None else {"bound": bound.bound, "value": _brief(bound.value)}


def _brief(value: float) -> float:
    """Return a number that has no error, to six digits."""
    return float(f"{value:.6g}")


def _standard(name: str, figure: EmvaFigure | None) -> dict[str, Json] | None:
    if figure is None:
        return None
    held = asdict(figure) | {"symbol": EMVA_SYMBOLS[name]}
    if figure.bound is None:
        del held["bound"]
        return held
    return {"bound": figure.bound, "value": _brief(figure.value), "n": figure.n, "symbol": held["symbol"]}


def _curve(transfer: PhotonTransfer) -> dict[str, Json]:
    points = transfer.points
    return {
        "signal_dn": points.signal_dn.tolist(),
        "variance_dn2": points.variance_dn2.tolist(),
        "std_error_dn2": points.std_error_dn2.tolist(),
        "used": transfer.used.tolist(),
        "fit": "variance_dn2 = gain_dn_per_e * signal_dn + bend * signal_dn**2 + cubic * signal_dn**3",
        "gain_dn_per_e": transfer.gain_dn_per_e,
        "bend": transfer.bend,
        "cubic": transfer.cubic,
        "relative_scatter": transfer.fit.scatter / transfer.gain_dn_per_e,
        "chi2_per_dof": transfer.fit.chi2_per_dof,
    }


def _linearity(transfer: PhotonTransfer) -> dict[str, Json] | None:
    curve, spreading = transfer.linearity, brighter_fatter(transfer)
    if curve is None:
        return None
    return {
        "fit": "signal_dn = x * (1 + quadratic_per_dn * x + cubic_per_dn2 * x**2), x proportional to the light",
        "light": curve.light,
        "quadratic_per_dn": curve.quadratic_per_dn,
        "cubic_per_dn2": curve.cubic_per_dn2,
        "covariance": covariance_rows(curve.covariance),
        "relative_scatter": curve.relative_scatter,
        "brighter_fatter": None
        if spreading is None
        else {"value": spreading[0], "std_error": spreading[1], "signal_dn": transfer.top_dn},
    }


def _dark_levels(noise: NoiseCalibration) -> list[dict[str, Json]]:
    return [
        {
            "exposure_s": level.exposure_s,
            "mean_dn": level.mean_dn,
            "temporal_variance_dn2": level.temporal_variance_dn2,
            "temporal_std_error_dn2": level.temporal_std_error_dn2,
            "n": level.n_frames,
        }
        for level in noise.darks
    ]


def _pattern(pattern: FixedPattern) -> dict[str, Json]:
    """Return spectrograms, histograms and defects."""
    return {
        "signal_dn": pattern.signal_dn,
        "n_dark_frames": pattern.n_dark_frames,
        "n_flat_frames": pattern.n_flat_frames,
        "spectrograms": {
            "dark_rows_dn": _spectrum(pattern.dark_rows),
            "dark_columns_dn": _spectrum(pattern.dark_columns),
            "response_rows": _spectrum(pattern.response_rows),
            "response_columns": _spectrum(pattern.response_columns),
        },
        "histograms": {
            "dark_dn": _histogram(pattern.dark_histogram),
            "response": _histogram(pattern.response_histogram),
        },
        "defects": _defects(pattern),
    }


def _spectrum(found: Spectrogram) -> dict[str, Json]:
    return {
        "frequency_per_pixel": [round(float(value), 6) for value in found.frequency_per_pixel],
        "amplitude": [float(f"{value:.5g}") for value in found.amplitude],
    }


def _histogram(found: PatternHistogram) -> dict[str, Json]:
    return {
        "centres": [float(f"{value:.6g}") for value in found.centres],
        "counts": found.counts.tolist(),
        "sigma": found.sigma,
    }


def _defects(pattern: FixedPattern) -> dict[str, Json]:
    found = pattern.defects
    rows, columns = np.nonzero(found.mask)
    return {
        "n": found.n_defect,
        "counts": found.counts,
        "dark_limit_dn": found.dark_limit_dn,
        "response_limit": found.response_limit,
        "noise_limit_dn2": found.noise_limit_dn2,
        "kinds": {str(defect.name).lower(): defect.value for defect in Defect},
        "listed": [
            {"x": int(x), "y": int(y), "kind": int(found.mask[y, x])}
            for y, x in zip(rows[:_LISTED], columns[:_LISTED], strict=True)
        ],
    }


# Largest number of levels measured at a time, and their memory: 24 bytes a pixel for each.
_WORKERS, _WORK_BYTES, _BYTES_PER_PIXEL = min(4, os.cpu_count() or 1), 200_000_000, 24

LevelDone = Callable[[int, int], None]


def calibrate_frames(frames: FrameSet, *, level_done: LevelDone | None = None) -> NoiseCalibration:
    """Return the noise calibration of a set of frames.

    Each frame is read once. The fixed pattern is taken from the level with the most frames; if several have as many,
    one is read a second time, so that memory is bounded.
    """
    if any(flag.refuses for flag in frames.flags):
        raise RefusedFramesError(frames.flags)
    groups = [group for group in frames.groups if len(group.loaders) > 1]
    levels, workers = [], _workers(groups)
    # Threads help, as reading and arithmetic release the interpreter.
    with ThreadPoolExecutor(max_workers=workers) as pool:
        # Memory that a thread frees is not returned: large frames are measured without threads.
        of_each = pool.map if workers > 1 else map
        measured = of_each(_measure, groups, [_is_the_stack(group, groups) for group in groups])
        for done, level in enumerate(measured, start=1):
            levels.append(level)
            if level_done is not None:
                level_done(done, len(groups))
    noise = calibrate_noise(
        levels, bit_depth=frames.bit_depth, stated=frames.stated, black_level_dn=frames.black_level_dn
    )
    noise = with_pattern(noise, _fixed_pattern(noise, dict(zip(map(id, levels), groups, strict=True))))
    flags = (*noise.flags, *frames.flags)
    if singles := len(frames.groups) - len(groups):
        flags += (_single_frames(singles),)
    return replace(noise, flags=by_consequence(flags))


def _workers(groups: Sequence[FrameGroup]) -> int:
    pixels = groups[0].loaders[0]().size if groups else 1
    return max(1, min(_WORKERS, _WORK_BYTES // (_BYTES_PER_PIXEL * pixels)))


def _is_the_stack(group: FrameGroup, groups: Sequence[FrameGroup]) -> bool:
    """Return true if a group has the most frames of its kind: the fixed pattern is taken from it."""
    others = [len(other.loaders) for other in groups if other.kind == group.kind and other is not group]
    return len(group.loaders) > max(others, default=0)


def _measure(group: FrameGroup, keep_picture: bool) -> LevelStatistics:
    try:
        return level_statistics(
            (load() for load in group.loaders),
            kind=group.kind,
            exposure_s=group.exposure_s,
            photons=group.photons,
            keep_picture=keep_picture,
        )
    except CalibrationError as error:
        raise DataError(f"{group.kind} frames at {group.exposure_s} s: {error}") from error


def _fixed_pattern(noise: NoiseCalibration, groups: dict[int, FrameGroup]) -> FixedPattern | None:
    if noise.stacks is None:
        return None
    flat, dark = (
        level if level.picture is not None else _measure(groups[id(level)], keep_picture=True) for level in noise.stacks
    )
    return fixed_pattern(dark, flat)


def _single_frames(levels: int) -> Flag:
    return Flag(
        name="single_frames",
        message=f"{levels} dark or flat frames are single and left out, as noise takes two: "
        f"take two frames or more at each exposure",
    )
