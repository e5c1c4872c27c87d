"""``rigctl calibrate lens``: focal length, principal point and distortion from pictures of a chessboard."""

from pathlib import Path
from typing import Annotated

import typer

from rigctl.console.terminal import print_json, results, warn


def lens(
    pictures: Annotated[
        list[Path], typer.Argument(metavar="PICTURE...", help="Images of the board, tilted differently in each.")
    ],
    *,
    board: Annotated[str, typer.Option(metavar="CxR", help="Inner corners along its sides, such as 9x6.")],
    square_mm: Annotated[float, typer.Option(metavar="MM", min=0.001, help="Side of a square.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="File for `rigctl point --lens`, such as lens.json.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the calibration as JSON.")] = False,
) -> None:
    """Find focal length, principal point and distortion of a lens from pictures of a chessboard, each with its error.

    Ten pictures or more, the board over all of the field and tilted by 20 to 40 deg in different directions, at the
    focus of use. `rigctl point` takes the file.

    Example: rigctl calibrate lens board-01.png board-02.png board-03.png --board 9x6 --square-mm 25 --out lens.json
    """
    from rigctl.jobs.calibrate_lens import calibrate_lens_of

    found, content = calibrate_lens_of(pictures, board=board, square_mm=square_mm, out=out)
    for place in found.unused:
        warn(f"{pictures[place]}: does not show the whole board, left out")
    if as_json:
        print_json(content)
        return
    results().print(f"{len(found.used)} pictures, corners {found.rms_px:.3f} pixel about where they should be")
    for name, value, variance in zip(
        ("focal length right", "focal length down", "axis right", "axis down"),
        found.lens.parameters[:4].tolist(),
        found.lens.covariance.diagonal()[:4].tolist(),
        strict=True,
    ):
        results().print(f"{name:<20} {value:.2f} +- {variance**0.5:.2f} pixel", markup=False)
