"""Trace of a session's devices: bytes and settings as plain text, until the end."""

import re
import zipfile
from pathlib import Path

import pytest

from rigctl import cli
from rigctl.rig.rig import Trace
from tests.rigctl.example_files import SHORT_SESSION, small_rig_text

DRIVERS = {
    "ellx": ('driver = "ellx"', "sim:ellx?speed=50"),
    "apt": ('driver = "apt"', "sim:apt?speed=50"),
    "zaber": ('driver = "zaber"', "sim:zaber?speed=50"),
}
LINE = re.compile(r"(\d+\.\d{6}) (\S+) (.+)")


def files(folder: Path, *, stage: str = "ellx", port: str | None = None) -> list[str]:
    """Write rig and session file of the small rig with a stage."""
    driver, simulated = DRIVERS[stage]
    text = small_rig_text(folder).replace('driver = "ellx"', driver)
    text = text.replace('port = "sim:ellx?speed=20"', f'port = "{port or simulated}"')
    text = text if stage == "ellx" else text.replace('address = "0"\n', "")
    (folder / "rig.toml").write_text(text)
    (folder / "session.toml").write_text(f'{SHORT_SESSION}\n[interlocks]\nfault = "stop"\ngone = "stop"\n')
    return [str(folder / "rig.toml"), str(folder / "session.toml")]


def lines_of(trace: Path) -> list[tuple[str, str]]:
    """Return who spoke and what, once times are found to grow."""
    found = [LINE.fullmatch(line) for line in trace.read_text().splitlines()]
    events = [one.groups() for one in found if one is not None]
    assert len(events) == len(found)
    times = [float(time_s) for time_s, _, _ in events]
    assert times == sorted(times)
    return [(who, what) for _, who, what in events]


@pytest.mark.parametrize("stage", sorted(DRIVERS))
def test_both_directions_of_the_line_and_the_camera_are_written_down(tmp_path: Path, stage: str) -> None:
    trace = tmp_path / "trace.txt"
    assert (
        cli.main(["acquire", *files(tmp_path, stage=stage), "--out", str(tmp_path / "run"), "--trace", str(trace)]) == 0
    )
    lines = lines_of(trace)
    for direction in "><":
        data = b"".join(bytes.fromhex(what[2:]) for _, what in lines if what.startswith(f"{direction} "))
        assert len(data) > 20
    camera = [what for who, what in lines if who == "camera"]
    assert camera[0].startswith("is model=")
    assert sum(what.startswith("frame ") for what in camera) == 5
    assert any(what.startswith("set exposure_s=") for what in camera)


def test_a_device_that_fails_is_in_the_trace_and_the_bundle(tmp_path: Path) -> None:
    trace, run, packed = tmp_path / "trace.txt", tmp_path / "run", tmp_path / "fault.zip"
    arguments = files(tmp_path, port="sim:ellx?speed=50&stall=2")
    assert cli.main(["acquire", *arguments, "--out", str(run), "--trace", str(trace)]) == 3
    assert any(what.startswith("< ") for _, what in lines_of(trace))
    assert cli.main(["bundle", str(run), "--out", str(packed), "--trace", str(trace)]) == 0
    with zipfile.ZipFile(packed) as archive:
        bundled = archive.read("trace.txt").decode()
    # A bundle does not tell names of people; a port may lie in somebody's folder.
    assert re.sub(r"/\S+/port", "PORT", bundled) == re.sub(r"/\S+/port", "PORT", trace.read_text())


def test_an_existing_file_is_refused_before_a_device_is_opened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "trace.txt").write_text("mine")
    arguments = [*files(tmp_path), "--out", str(tmp_path / "run"), "--trace", str(tmp_path / "trace.txt"), "--json"]
    assert cli.main(["acquire", *arguments]) == 2
    assert "--trace" in capsys.readouterr().err
    assert (tmp_path / "trace.txt").read_text() == "mine"
    assert not (tmp_path / "run").exists()


def test_a_port_that_goes_away_and_a_full_disk_stop_nothing(caplog: pytest.LogCaptureFixture) -> None:
    class Full:
        written = 0

        def write(self, text: str) -> int:
            self.written += 1
            if self.written > 2:
                raise OSError(28, "No space left on device")
            return len(text)

    trace = Trace(Full(), now_s=lambda: 0.0)  # type: ignore[arg-type]
    trace.hear(b"", port="/dev/stage", from_host=False)
    trace.hear(b"0in", port="/dev/stage", from_host=True)
    trace.hear(b"0in", port="/dev/stage", from_host=True)
    assert caplog.text.count("No space left") == 1
