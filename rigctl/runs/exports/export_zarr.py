"""A run as a Zarr group."""

from pathlib import Path

from rigctl.errors import ConfigError
from rigctl.runs.exports.export_frames import columns_of, common_shape
from rigctl.runs.run_folder import Run


def export_zarr(run: Run, out: Path) -> None:
    """Write a run into a Zarr folder: an array `counts` (N, H, W), one chunk a frame, and attributes.

    Raises
    ------
    ConfigError
        zarr is not installed.
    RunFolderError
        A frame is damaged, or they differ in size.

    Notes
    -----
    The group's attribute `frames` has every field of the frames' records by its name, one value a frame; `session` what
    the run says of itself.
    """
    try:
        import zarr
    except ImportError as error:
        raise ConfigError("--to zarr needs zarr: pip install 'rigctl[export]'") from error
    height, width = common_shape(run)
    group = zarr.open_group(str(out), mode="w-")
    counts = group.create_array(
        "counts",
        shape=(len(run.frames), height, width),
        chunks=(1, height, width),
        dtype="u2",
        dimension_names=("frame", "y", "x"),
        attributes={"unit": "DN"},
    )
    for place, record in enumerate(run.frames):
        counts[place] = run.counts(record)
    group.attrs.update({"frames": columns_of(run), "session": run.session_json, "created_by": run.created_by})
