"""``rigctl import``: make a run out of images that exist."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from drivers.cameras.raw_planes import PLANES
from rigctl.console.options import MaxFrameMb, OptionTexts, frame_bytes
from rigctl.console.terminal import print_json, results
from rigctl.files.choices import FRAME_KINDS
from rigctl.storage.bounded_file import MOST_FRAME_MB

if TYPE_CHECKING:
    from rigctl.jobs.import_images import Imported

_NO_VALUE = "none"


def command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder: new, or imported before.")],
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="FITS, PNG, TIFF or camera RAW images.")],
    angles: Annotated[
        str | None,
        typer.Option(metavar="A,B,...", help="Polarizer angle of each file [deg], as in 0,60,-60."),
    ] = None,
    angle_key: Annotated[str | None, typer.Option(metavar="KEY", help="Header keyword with the angle [deg].")] = None,
    mosaic: Annotated[
        str | None,
        typer.Option(metavar="A,B,C,D", help="Angles of the 2 x 2 cell at the top left, row by row [deg]."),
    ] = None,
    kind: Annotated[str, typer.Option(metavar="|".join(FRAME_KINDS), help="What the camera saw.")] = "scene",
    exposure_s: Annotated[float | None, typer.Option(metavar="X", help="Exposure of every file [s].")] = None,
    exposure_key: Annotated[
        str | None, typer.Option(metavar="KEY", help="Header keyword with the exposure [s].")
    ] = None,
    same_exposure: Annotated[
        bool, typer.Option("--same-exposure", help="One exposure for all files, not known how long.")
    ] = False,
    black_level_dn: Annotated[
        float | None, typer.Option(metavar="X", help="Counts without light [DN as in the files].")
    ] = None,
    black_level_key: Annotated[
        str | None, typer.Option(metavar="KEY", help="Header keyword with the black level [DN].")
    ] = None,
    black_level_from_darks: Annotated[
        bool, typer.Option("--black-level-from-darks", help="Dark frames, imported too, tell the black level.")
    ] = False,
    bit_depth: Annotated[int | None, typer.Option(metavar="N", help="Bits of the camera, 1 to 16.")] = None,
    justified: Annotated[
        str | None, typer.Option(metavar="left|right", help="Where these bits stand, if the counts do not tell.")
    ] = None,
    saturation_dn: Annotated[
        float | None, typer.Option(metavar="X", help="Saturated at and above this [DN as in the files].")
    ] = None,
    missing_dn: Annotated[
        str | None,
        typer.Option(metavar="X|none", help="Value of pixels not received [DN as in the files], or none."),
    ] = None,
    no_border_search: Annotated[
        bool, typer.Option("--no-border-search", help="Do not look for constant pixels along the edges.")
    ] = False,
    first_row: Annotated[
        str | None,
        typer.Option(metavar="top|bottom", help="First row in the files. FITS: bottom, unless ROWORDER says."),
    ] = None,
    plane: Annotated[
        str | None,
        typer.Option(metavar="|".join(PLANES), help="Colour of RAW files; green-1 stands in the rows of red."),
    ] = None,
    max_frame_mb: MaxFrameMb = MOST_FRAME_MB,
    as_json: Annotated[bool, typer.Option("--json", help="Answer in JSON.")] = False,
) -> None:
    """Make a run out of images that exist, or add images of another kind to such a run.

    Angles are those of the transmission axis, counter-clockwise from horizontal in the picture as shown. What
    cannot be known from the files is asked for; what is recognised in them is said, and noted in every frame.

    Examples: rigctl import runs/fruits fruits.png --mosaic 90,45,135,0 --black-level-dn 0

    rigctl import runs/corona a.fits b.fits c.fits --angles 0,60,-60 --exposure-key EXPTIME
    --black-level-key OFFSET --bit-depth 16

    rigctl import runs/sky a.dng b.dng c.dng --angles 0,60,-60 --plane green-1 --exposure-key EXPTIME
    --black-level-key BLACK --bit-depth 12
    """
    from rigctl.imports.import_request import ImportRequest
    from rigctl.jobs.import_images import import_images

    texts = OptionTexts()
    request = ImportRequest(
        run=run,
        files=tuple(files),
        kind=texts.choice("--kind", kind, FRAME_KINDS) or "scene",
        angles_deg=texts.numbers("--angles", angles),
        angle_key=angle_key,
        mosaic_deg=texts.numbers("--mosaic", mosaic),
        exposure_s=exposure_s,
        exposure_key=exposure_key,
        same_exposure=same_exposure,
        black_level_dn=black_level_dn,
        black_level_key=black_level_key,
        black_level_from_darks=black_level_from_darks,
        bit_depth=bit_depth,
        justified=texts.choice("--justified", justified, ("left", "right")),
        saturation_dn=saturation_dn,
        missing_dn=None if missing_dn == _NO_VALUE else texts.number("--missing-dn", missing_dn),
        none_missing=missing_dn == _NO_VALUE,
        no_border_search=no_border_search,
        first_row=texts.choice("--first-row", first_row, ("top", "bottom")),
        plane=texts.choice("--plane", plane, PLANES),
        most_bytes=frame_bytes(max_frame_mb),
        misread=texts.problems,
    )
    _report(run, import_images(request), as_json=as_json)


def _report(run: Path, imported: "Imported", *, as_json: bool) -> None:
    from rigctl.measurement.fault_terms import fault_lines
    from rigctl.reports.tables.numbers_json import diagnosis_json

    if as_json:
        files = [record.file for record in imported.frames]
        told = diagnosis_json(imported.diagnosis)
        print_json({"run": str(run), "frames": files, "remarks": list(imported.remarks), "diagnosis": told})
        return
    first = imported.frames[0]
    size = f"{first.width} x {first.height} pixels, {first.bit_depth} bits"
    results().print(f"{run}: {len(imported.frames)} {first.kind} frames of {size}", markup=False)
    for remark in imported.remarks:
        results().print(f"  note: {remark}", markup=False)
    if first.kind == "scene":
        for line in fault_lines(imported.diagnosis.named, imported.diagnosis.reason):
            results().print(f"  first look: {line}", markup=False)
