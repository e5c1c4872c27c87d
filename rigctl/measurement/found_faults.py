"""Faults that a run shows of itself, as corrections of its frames."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.polarimeter.pictures import moved_back
from model.processing.fault_fit import PER_FRAME
from rigctl.errors import ConfigError
from rigctl.measurement.corrections import FoundCorrections
from rigctl.measurement.frame_grid import FrameGrid
from rigctl.measurement.image_registration import FrameShifts
from rigctl.measurement.run_diagnosis import RunDiagnosis
from rigctl.measurement.throughput_division import Throughput

FloatArray = NDArray[np.float64]

CORRECTABLE = ("throughput", "dark-level", "shift")
# Faults that are smaller change nothing that is seen.
_NOTHING = 1e-12


def correctable(text: str) -> tuple[str, ...]:
    """Return the names of a comma-separated list of what is to be corrected.

    Raises
    ------
    ConfigError
        One of them is not known.
    """
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    unknown = [name for name in names if name not in CORRECTABLE]
    if unknown or not names:
        raise ConfigError(f"--correct: is {text!r}; allowed are {', '.join(CORRECTABLE)}, separated by commas")
    return names


def found_faults(grid: FrameGrid, diagnosis: RunDiagnosis, names: Sequence[str]) -> FoundCorrections:
    """Return the corrections that a diagnosis asks for.

    Parameters
    ----------
    grid : FrameGrid
        Of the run.
    diagnosis : RunDiagnosis
        Of its frames as they are.
    names : sequence of str
        Of `CORRECTABLE`: others are left as they are.
    """
    sizes, errors = _sizes(grid, diagnosis)
    throughput, dark = sizes[0], sizes[2]
    moved = sizes[3:5].T - sizes[3:5].T[0]
    is_done = {
        "throughput": bool(np.any(np.abs(throughput) > _NOTHING)),
        "dark-level": bool(np.any(np.abs(dark) > _NOTHING)),
        "shift": bool(np.any(np.abs(moved) > _NOTHING)),
    }
    taken = {name: name in names and done for name, done in is_done.items()}
    return FoundCorrections(
        throughput=Throughput(value=1.0 + throughput, error=errors[0]) if taken["throughput"] else None,
        dark=dark if taken["dark-level"] else None,
        shifts=_shifts(grid, moved) if taken["shift"] else None,
        dark_error=errors[2] * taken["dark-level"],
        shift_error=errors[3:5].T * taken["shift"],
        remarks=tuple(_remarks(names, taken, sizes, moved)),
    )


def _sizes(grid: FrameGrid, diagnosis: RunDiagnosis) -> tuple[FloatArray, FloatArray]:
    """Return the size of each kind of fault by angle, and its error, shape (kinds, N); repeats are averaged."""
    frames = len(diagnosis.angles_deg)
    kinds = len(PER_FRAME)
    total, variance = np.zeros((kinds, frames)), np.zeros((kinds, frames))
    for term in diagnosis.found.terms:
        if term.is_named and term.value:
            own = term.parameters[: kinds * frames].reshape(kinds, frames)
            total += own
            variance += np.square(own / term.value * (term.std_error or 0.0))
    by_cycle = (kinds, frames // grid.angles, grid.angles)
    return total.reshape(by_cycle).mean(axis=1), np.sqrt(variance.reshape(by_cycle).mean(axis=1))


def _shifts(grid: FrameGrid, moved: FloatArray) -> FrameShifts:
    by_frame = {record.sequence: moved[angle] for cycle in grid.records for angle, record in enumerate(cycle)}
    one_pixel = np.zeros((4, 4))
    return FrameShifts(
        shifts_pixels=by_frame,
        variance_factor=np.array([moved_back(one_pixel, shift)[1] for shift in moved]),
        margin_pixels=int(np.ceil(np.max(np.abs(moved)))),
    )


def _remarks(names: Sequence[str], taken: dict[str, bool], sizes: FloatArray, moved: FloatArray) -> Iterable[str]:
    said = {
        "throughput": f"frames were divided by {_listed(1.0 + sizes[0], '.4f')}",
        "dark-level": f"{_listed(sizes[2], '+.3g')} were taken off beside the dark level",
        "shift": f"frames were moved back by {_listed(np.linalg.norm(moved, axis=1), '.2f')} pixel",
    }
    for name in names:
        done = said[name] if taken[name] else "there was nothing to correct"
        yield f"corrected by what the run shows, {name}: {done}"


def _listed(values: FloatArray, digits: str) -> str:
    return ", ".join(format(value, digits) for value in values.tolist())
