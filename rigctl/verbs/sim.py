"""Simulated devices for other programs: a stage, a camera, and the focus of a simulated lens."""

import signal
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from rigctl.console import Json, note
from rigctl.errors import ConfigError
from rigctl.verbs.options import FilePath, Part, Result, Writes


def stage(
    address: str,
    /,
    *,
    link: Annotated[FilePath, Writes(kind="absent")],
    truth: Annotated[FilePath | None, Writes()] = None,
) -> None:
    """Serve a simulated rotation stage on a pseudo-terminal until it is stopped (Ctrl-C, or SIGTERM).

    Any program can open the link as a serial port. A wrong address prints the allowed keys.

    Example: rigctl sim stage "sim:ellx?stall=3&pace=1" --link /tmp/stage --truth /tmp/stage.csv

    Parameters
    ----------
    address : str
        Address of the stage, such as sim:ellx, sim:zaber or sim:apt?stall=3.
    link : path
        Path of the port to make, such as /tmp/stage.
    truth : path
        CSV file to write: simulated time [s], true angle [deg].
    """
    from rigctl.rig.simulation import serve_stage

    try:
        with (
            _until_stopped(),
            serve_stage(address, link=Path(link), truth=None if truth is None else Path(truth)) as run,
        ):
            note(f"{address} answers on {link}; Ctrl-C ends it")
            run()
    except FileExistsError as error:
        raise ConfigError(f"--link: {link} exists already: remove it, or give another path") from error
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot be written: {error.strerror}") from error


def camera(
    address: str,
    /,
    *,
    rig: FilePath | None = None,
    lost: Annotated[float, Parameter(validator=validators.Number(gte=0.0, lte=1.0))] = 0.0,
) -> None:
    """Serve the camera of a simulated rig as a GigE Vision camera, with its stage, until it is stopped.

    Any GigE Vision program finds it. Turn the polarizer through the printed port of the stage.

    Example: rigctl sim camera 127.0.0.1 --lost 0.001

    Parameters
    ----------
    address : str
        Address of this machine, such as 127.0.0.1 or 127.0.0.1?hang=20.
    rig : path
        Rig file with the scene that the camera sees; default: the rig of the demo.
    lost : float
        Share of packets that are lost, 0 to 1.
    """
    from rigctl.rig.simulation import serve_rig_camera

    rig_path = None if rig is None else Path(rig)
    with _until_stopped(), serve_rig_camera(address, rig_path=rig_path, lost_share=lost) as stage_port:
        note(f"GigE Vision camera on {address}, its stage on {stage_port}; Ctrl-C ends it")
        signal.pause()


def lens(rig: FilePath, /, *, defocus_mm: float) -> "LensResult":
    """Turn the lens of a simulated camera, also while it runs, to try focusing.

    The command changes defocus_mm in the rig file. A running simulated camera uses it from its next picture on.

    Example: rigctl sim lens rig-sim.toml --defocus-mm 0.1

    Parameters
    ----------
    rig : path
        Rig file with a simulated camera.
    defocus_mm : float
        Distance of the detector from the focus, -5 to 5 mm; 0 is sharp.
    """
    from rigctl.rig.simulated_parts import turn_lens

    was_mm, blur_px = turn_lens(Path(rig), defocus_mm=defocus_mm)
    return LensResult(rig=Path(rig), defocus_mm=defocus_mm, was_mm=was_mm, blur_px=blur_px)


@dataclass(frozen=True, kw_only=True)
class LensResult(Result):
    """Focus of a simulated camera, before and now."""

    rig: Path
    defocus_mm: float  #: Present distance of the detector behind the focus [mm].
    was_mm: float  #: Previous distance [mm].
    blur_px: float  #: Diameter of the image of a point [pixels].

    def content(self) -> Iterable[Part]:
        """Return a sentence about the focus."""
        yield (
            f"{self.rig}: defocus {self.defocus_mm:g} mm, was {self.was_mm:g} mm; a point is a disk of "
            f"{self.blur_px:.1f} pixels"
        )

    def as_json(self) -> dict[str, Json]:
        """Return the numbers."""
        return {"defocus_mm": self.defocus_mm, "was_mm": self.was_mm, "blur_px": self.blur_px}


@contextmanager
def _until_stopped() -> Iterator[None]:
    """End normally on Ctrl-C or SIGTERM."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)
