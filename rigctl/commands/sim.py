"""``rigctl sim``: simulated devices for other programs."""

import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, progress, results
from rigctl.errors import ConfigError

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def sim() -> None:
    """Serve simulated devices to other programs.

    Example: rigctl sim stage "sim:ellx?stall=3" --link /tmp/stage
    """


@app.command("stage")
def stage_command(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="Such as sim:ellx, sim:zaber or sim:apt?stall=3.")],
    link: Annotated[Path, typer.Option(metavar="PATH", help="Link to make to the pseudo-terminal.")],
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Log of the true angle: simulated time [s], angle [deg].")
    ] = None,
) -> None:
    """Serve a simulated rotation stage on a pseudo-terminal until it is stopped (Ctrl-C, or SIGTERM).

    Any program can open the link as a serial port. A wrong address prints all keys that an address can have.

    Example: rigctl sim stage "sim:ellx?stall=3&pace=1" --link /tmp/stage --truth /tmp/stage.csv
    """
    from rigctl.simulated.serving import serve_stage

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with serve_stage(address, link=link, truth=truth) as server:
            progress().print(f"{address} answers on {link}; Ctrl-C ends it", markup=False)
            server.run()
    except KeyboardInterrupt:
        sys.stderr.write("\n")
    except FileExistsError as error:
        raise ConfigError(f"--link: {link} is there already: remove it, or name another") from error
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot be written: {error.strerror}") from error


@app.command("camera")
def camera_command(
    address: Annotated[
        str, typer.Argument(metavar="ADDRESS", help="Of this machine, such as 127.0.0.1 or 127.0.0.1?hang=20.")
    ],
    rig: Annotated[Path | None, typer.Option(metavar="RIG.toml", help="What it sees; without: the demo's rig.")] = None,
    lost: Annotated[float, typer.Option(metavar="X", min=0.0, max=1.0, help="Share of packets not sent.")] = 0.0,
) -> None:
    """Serve the camera of a simulated rig as a GigE Vision camera, with its stage, until it is stopped.

    Any GigE Vision program finds it. Turn the polarizer by the stage's port, which is printed.

    Example: rigctl sim camera 127.0.0.1 --lost 0.001
    """
    from rigctl.simulated.serving import serve_rig_camera

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with serve_rig_camera(address, rig_path=rig, lost_share=lost) as stage_port:
            text = f"GigE Vision camera on {address}, its stage on {stage_port}; Ctrl-C ends it"
            progress().print(text, markup=False)
            signal.pause()
    except KeyboardInterrupt:
        sys.stderr.write("\n")


@app.command("lens")
def lens_command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="Rig file with a simulated camera.")],
    defocus_mm: Annotated[
        float, typer.Option(metavar="MM", help="Distance of the detector from the focus, -5 to 5; 0 is sharp.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Turn the lens of a simulated camera, also while it runs, to try focusing.

    It changes defocus_mm in the rig file and nothing else there; a simulated camera of that file has it in its next
    picture.

    Example: rigctl sim lens rig-sim.toml --defocus-mm 0.1
    """
    from rigctl.simulated.lens_position import turn_lens

    turned = turn_lens(rig, defocus_mm=defocus_mm)
    if as_json:
        print_json({"defocus_mm": turned.defocus_mm, "was_mm": turned.was_mm, "blur_px": turned.blur_px})
        return
    results().print(
        f"{rig}: defocus {turned.defocus_mm:g} mm, was {turned.was_mm:g} mm; a point is a disk of "
        f"{turned.blur_px:.1f} pixels",
        markup=False,
    )
