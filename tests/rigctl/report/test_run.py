"""The page on how a session went."""

from dataclasses import replace

import pytest

from drivers.errors import DeviceFaultError, LimitError
from rigctl.cli import main
from rigctl.measure.diagnose import quick_diagnosis
from rigctl.report.files import html
from rigctl.report.run import run_report
from rigctl.runs.folder import read_run
from rigctl.runs.records import SimulatedLight
from rigctl.session.history import session_history
from rigctl.session.take import take_session
from tests.rigctl.session.made_rig import RIG_FILE, MadeWorld, stalled, take_watched
from tests.rigctl.session.test_plan import RIG_AT_SITE, scheduled


def _run(tmp_path, rig, schedule):
    world = MadeWorld()
    session = scheduled(schedule)
    take_session(rig, session, tmp_path / "run", files={}, clock=world.time.clock, opener=world.open)
    return tmp_path / "run"


def _page(run):
    return html(run_report(session_history(read_run(run)), quick_diagnosis(read_run(run))))


def test_it_holds_frames_counts_sun_and_events(tmp_path):
    run = _run(tmp_path, RIG_AT_SITE, {"every_min": 30, "duration_h": 1})
    assert main(["status", str(run), "--page", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text()
    assert page.count("data:image/png;base64,") == 4
    assert '<td class="l">round</td><td class="l">2</td>' in page
    assert 'src="http' not in page


def test_it_says_what_a_simulated_roof_proves_and_what_not(tmp_path):
    run = read_run(_run(tmp_path, RIG_FILE, {"every_min": 30, "duration_h": 1}))
    light = SimulatedLight(scene="roof", is_clocked=True, perturbed="visibility times 0.7")
    roof = replace(run, session=replace(run.session, origin="simulated", simulated_light=light))
    page = html(run_report(session_history(roof), quick_diagnosis(roof)))
    assert "Limits of a simulated run" in page
    assert "It cannot test the scene model" in page
    assert "visibility times 0.7" in page


def test_without_a_site_there_is_no_sun(tmp_path):
    page = _page(_run(tmp_path, RIG_FILE, {"every_min": 30, "duration_h": 1}))
    assert page.count("data:image/png;base64,") == 3


def test_it_says_how_the_light_drifted(tmp_path):
    page = _page(_run(tmp_path, RIG_FILE, {"every_min": 30, "duration_h": 1}))
    # One cycle a round, and no angle twice in it.
    assert "Drift within rounds: not known" in page


def test_a_session_that_was_cut_off_in_its_first_cycle_has_no_polarization_yet(tmp_path):
    world = MadeWorld(stage_faults={2: stalled()})
    with pytest.raises(DeviceFaultError):
        take_watched(world, tmp_path)
    assert _page(tmp_path / "run").count("data:image/png;base64,") == 2


def test_a_session_without_a_frame_has_its_events(tmp_path):
    world = MadeWorld()
    world.stage.is_homed = False
    with pytest.raises(LimitError):
        take_watched(world, tmp_path)
    page = _page(tmp_path / "run")
    assert "base64" not in page
    assert "reference mark" in page
