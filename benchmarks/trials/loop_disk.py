"""Small disks of their own for trials and tests: ext4 in a file, on a loop device. Needs root."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_TRY_BYTES = 32 * 1024 * 1024


def why_not() -> str | None:
    """Return why no such disk can be mounted here, or None."""
    if os.geteuid() != 0:
        return "needs root, for a loop device"
    missing = [tool for tool in ("losetup", "mkfs.ext4", "mount", "umount") if shutil.which(tool) is None]
    if missing:
        return f"needs {', '.join(missing)}"
    with tempfile.TemporaryDirectory() as folder:
        try:
            image = ext4_image(Path(folder) / "try.img", size_bytes=_TRY_BYTES)
            with mounted(image, Path(folder) / "try"):
                return None
        except subprocess.CalledProcessError as error:
            return f"no loop device can be mounted here: {error.stderr}"


def ext4_image(path: Path, *, size_bytes: int) -> Path:
    """Make an empty file system in a file; return its path."""
    with path.open("wb") as file:
        file.truncate(size_bytes)
    call("mkfs.ext4", "-q", "-F", path)
    return path


@contextmanager
def mounted(image: Path, place: Path) -> Iterator[Path]:
    """Give a folder in which the file system of an image is mounted, until the context is left."""
    place.mkdir(exist_ok=True)
    call("mount", "-o", "loop", image, place)
    try:
        yield place
    finally:
        call("umount", place)


def call(*command: str | Path) -> None:
    """Run a command that has to succeed."""
    subprocess.run(command, check=True, capture_output=True, text=True)
