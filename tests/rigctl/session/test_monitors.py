"""Sensors beside the frames: read once an exposure, by plug-ins too, and never at the cost of a frame."""

import os
import sys
import textwrap
import time
from pathlib import Path

import pytest

from drivers.errors import DeviceTimeoutError, LimitError, NotConnectedError, ProtocolError
from drivers.monitors import open_command_monitor, open_file_monitor, open_serial_monitor
from rigctl.errors import ConfigError, RunFolderError
from rigctl.files.rig_file import MonitorSection, RigFile
from rigctl.rig.rig import require_drivers
from rigctl.runs.folder import read_run
from rigctl.runs.records import RunEvent, monitor_traces, read_events
from rigctl.session.monitors import Monitors
from rigctl.session.take import resume_session, take_session
from rigctl.verbs.doctor import monitor_findings
from rigctl.verbs.status import SessionPage, status
from rigctl.verbs.verify import verification_of
from tests.rigctl.example_files import small_rig, small_session

PLUG_IN = """
import threading
import time

class Sun:
    name, unit = "made sun sensor", "W m-2"
    def __init__(self, options):
        self.options, self.count = options, 0
    def read(self, deadline_s):
        self.count += 1
        kind = self.options.get("fault", "")
        if kind == "hangs":
            threading.Event().wait()
        if kind == "raises":
            raise RuntimeError("no such sun")
        if kind == "nan":
            return float("nan")
        return 800.0 + self.count

def open_sun(options):
    return Sun(options)
"""


@pytest.fixture
def plug_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package with an entry point, as pip would."""
    folder = tmp_path / "installed"
    info = folder / "made_sun-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "made_sun.py").write_text(textwrap.dedent(PLUG_IN))
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: made-sun\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[rigctl.monitors]\nsun = made_sun:open_sun\n")
    monkeypatch.syspath_prepend(str(folder))


def rig_with(folder: Path, *tables: dict) -> RigFile:
    rig = small_rig(folder)
    return RigFile.model_validate(rig.model_dump() | {"monitors": list(tables)})


def sun(**changes) -> dict:
    return {"name": "sun", "driver": "sun", "deadline_s": 0.3, "follows_light": True, **changes}


def air(folder: Path) -> dict:
    (folder / "air.txt").write_text("20.0\n21.5\n")
    return {"name": "air", "driver": "file", "options": {"path": str(folder / "air.txt"), "unit": "deg C"}}


@pytest.mark.usefixtures("plug_in")
def test_each_exposure_has_its_readings(tmp_path: Path) -> None:
    rig = rig_with(tmp_path, sun(), air(tmp_path))
    take_session(rig, small_session(), tmp_path / "run", files={})
    events = read_events(tmp_path / "run")
    by_name = {trace.monitor: trace for trace in monitor_traces(events)}
    assert list(by_name) == ["sun", "air"]
    told = by_name["sun"]
    assert (told.device, told.unit, told.follows_light) == ("made sun sensor", "W m-2", True)
    # Ten exposures; one that came before the reading of the last was back is without.
    assert len(told.values) + told.missing == 10
    assert list(told.values) == [801.0 + k for k in range(len(told.values))]
    assert set(by_name["air"].values) == {21.5}
    assert len(set(told.times_s)) == len(told.times_s)
    assert verification_of(tmp_path / "run").state == "whole"
    # A part that is resumed is read beside too.
    (tmp_path / "run" / read_run(tmp_path / "run").frames[-1].file).unlink()
    resume_session(tmp_path / "run")
    sequences = [e.facts["sequence"] for e in read_events(tmp_path / "run") if e.event == "monitor readings"]
    assert sequences == [*range(10), 9]


@pytest.mark.usefixtures("plug_in")
@pytest.mark.parametrize(
    ("fault", "words"), [("hangs", "no answer within 0.3 s"), ("raises", "no such sun"), ("nan", "nan")]
)
def test_a_sensor_that_fails_costs_no_frame(
    tmp_path: Path, fault: str, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    rig = rig_with(tmp_path, sun(options={"fault": fault}), air(tmp_path))
    outcome = take_session(rig, small_session(), tmp_path / "run", files={})
    assert outcome.is_finished
    assert outcome.frames == 10
    by_name = {trace.monitor: trace for trace in monitor_traces(read_events(tmp_path / "run"))}
    assert by_name["sun"].values == ()
    assert any(words in problem for problem in by_name["sun"].problems)
    assert caplog.text.count(words) == 1
    assert len(by_name["sun"].problems) <= 3
    assert set(by_name["air"].values) == {21.5}


@pytest.mark.usefixtures("plug_in")
def test_no_frame_waits_for_a_hanging_sensor() -> None:
    events: list[str] = []
    section = MonitorSection.model_validate(sun(deadline_s=60.0, options={"fault": "hangs"}))
    monitors = Monitors([section], lambda event, **_: events.append(event), time.time_ns)
    for sequence in range(20):
        monitors.look(sequence)
    assert events == []  # of a sensor that is waited for there is a reading, or a problem after its deadline


@pytest.mark.usefixtures("plug_in")
def test_the_page_and_the_doctor_tell_of_them(tmp_path: Path) -> None:
    rig = rig_with(tmp_path, sun(), air(tmp_path))
    take_session(rig, small_session(cycles=3), tmp_path / "run", files={})
    found = status(tmp_path / "run", page=tmp_path / "page.html")
    assert isinstance(found, SessionPage)
    page = (tmp_path / "page.html").read_text()
    assert "<h2>Monitors</h2>" in page
    assert "air (file" in page
    assert "is left" in page
    assert len(found.history.monitors) == 2
    said = {finding.found.partition(":")[0]: finding for finding in monitor_findings(rig.monitors)}
    assert said["sun"].found == "sun: 801 W m-2 (made sun sensor)"
    broken = rig_with(tmp_path, sun(options={"fault": "raises"}))
    (finding,) = monitor_findings(broken.monitors)
    assert "no such sun" in finding.found
    assert finding.advice is not None


def test_a_driver_that_is_not_installed_is_refused_before_anything_is_opened(tmp_path: Path) -> None:
    rig = rig_with(tmp_path, sun(driver="moon"))
    with pytest.raises(ConfigError, match=r"monitors.sun.driver: there is no driver 'moon'"):
        require_drivers(rig)


def test_names_of_sensors_differ(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="air"):
        rig_with(tmp_path, air(tmp_path), air(tmp_path))


def test_a_file_has_its_last_number_while_it_is_fresh(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_text("10:00,T=20.5,RH=40\n10:01,T=-3.25e0,RH=41\n")
    options = {"path": str(file), "unit": "deg C", "pattern": r"T=([-+.\deE]+)", "factor": 2.0, "offset": 1.0}
    assert open_file_monitor(options).read(1.0) == -5.5
    os.utime(file, (0.0, time.time() - 700.0))
    with pytest.raises(NotConnectedError, match="700 s ago"):
        open_file_monitor(options).read(1.0)
    file.write_text("none")
    with pytest.raises(ProtocolError, match="no number in 'none'"):
        open_file_monitor(options).read(1.0)
    file.unlink()
    with pytest.raises(NotConnectedError, match="cannot be read"):
        open_file_monitor(options).read(1.0)


def test_a_command_is_asked_and_ended_at_its_deadline() -> None:
    ask = [sys.executable, "-c", "print('humidity 41.5 %')"]
    assert open_command_monitor({"command": ask, "unit": "%"}).read(20.0) == 41.5
    with pytest.raises(DeviceTimeoutError, match=r"did not end within 0\.1 s"):
        open_command_monitor({"command": ["sleep", "30"], "unit": "%"}).read(0.1)
    with pytest.raises(NotConnectedError, match="failed with exit code 3"):
        open_command_monitor({"command": ["sh", "-c", "exit 3"], "unit": "%"}).read(20.0)
    with pytest.raises(NotConnectedError, match="cannot be started"):
        open_command_monitor({"command": ["no-such-program"], "unit": "%"}).read(1.0)


def test_a_line_over_a_serial_port_is_asked_for_and_read() -> None:
    ours, theirs = os.openpty()
    monitor = open_serial_monitor({"port": os.ttyname(theirs), "unit": "W m-2", "ask": "R\n", "pattern": r"G=(\d+)"})
    os.write(ours, b"G=1 old\r\n")
    from threading import Thread

    def answer() -> None:
        while b"R" not in os.read(ours, 64):
            pass
        os.write(ours, b"G=8")
        os.write(ours, b"12 W\r\n")

    thread = Thread(target=answer)
    thread.start()
    assert monitor.read(10.0) == 812.0
    thread.join()
    with pytest.raises(DeviceTimeoutError, match="no whole line"):
        monitor.read(0.1)
    monitor.close()
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"unit": "K"}, "path: must be text; is missing"),
        ({"path": "a", "unit": "K", "size": 3}, "size: is unknown"),
        ({"path": "a", "unit": "K", "factor": "2"}, "factor: must be a number"),
        ({"path": "a", "unit": "K", "pattern": "("}, "is not a regular expression"),
    ],
)
def test_options_that_cannot_be_are_refused(options: dict, words: str) -> None:
    with pytest.raises(LimitError, match=words):
        open_file_monitor(options)


def test_readings_without_a_time_are_refused_by_name() -> None:
    facts = {"sequence": 0, "read_utc": "soon", "readings": {"air": 1.0}, "problems": {}}
    with pytest.raises(RunFolderError, match="must be a time in UTC"):
        monitor_traces([RunEvent(event="monitor readings", facts=facts)])
