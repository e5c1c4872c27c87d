import pytest

from rigctl.errors import ConfigError
from rigctl.files.rig_file import load_rig
from rigctl.files.session_file import load_session
from rigctl.session.plan import estimate, plan_steps
from tests.rigctl.example_files import EXAMPLES


def _session(tmp_path, text):
    path = tmp_path / "session.toml"
    path.write_text('name = "test"\n' + text)
    return load_session(path)


def test_scene_angles_default_to_the_order_that_halves_the_drift(tmp_path):
    steps = plan_steps(_session(tmp_path, '[[take]]\nkind = "scene"\nexposure_ms = 1\n'))
    assert [step.polarizer_angle_deg for step in steps] == [0, 90, 45, 135]


def test_repeats_are_whole_cycles(tmp_path):
    steps = plan_steps(
        _session(tmp_path, '[[take]]\nkind = "scene"\nexposure_ms = 1\nangles_deg = [0, 60, 120]\ncycles = 2')
    )
    assert [(step.cycle, step.polarizer_angle_deg) for step in steps] == [
        (0, 0), (0, 60), (0, 120), (1, 0), (1, 60), (1, 120),
    ]  # fmt: skip


def test_exposures_are_in_seconds_and_numbers_run_on_over_takes(tmp_path):
    text = '[[take]]\nkind = "dark"\nexposure_ms = [1, 20]\n[[take]]\nkind = "flat"\nexposure_ms = 3\ncycles = 2\n'
    steps = plan_steps(_session(tmp_path, text))
    assert [(step.sequence, step.kind, step.exposure_s) for step in steps] == [
        (0, "dark", 0.001), (1, "dark", 0.02), (2, "flat", 0.003), (3, "flat", 0.003),
    ]  # fmt: skip
    assert all(step.polarizer_angle_deg is None for step in steps)


def test_flats_at_several_angles_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"first \[\[take\]\].*one angle"):
        _session(tmp_path, '[[take]]\nkind = "flat"\nexposure_ms = [1, 2]\nangles_deg = [0, 90]\n')


def test_time_and_disk_grow_with_the_frames():
    rig, session = load_rig(EXAMPLES / "rig-sim.toml"), load_session(EXAMPLES / "session.toml")
    steps = plan_steps(session)
    all_of_it, half = estimate(steps, rig), estimate(steps[: len(steps) // 2], rig)
    assert all_of_it.disk_bytes == 2 * half.disk_bytes
    assert all_of_it.disk_bytes > len(steps) * 2 * 782 * 582
    assert all_of_it.duration_s > half.duration_s


def test_disk_is_not_known_without_a_camera():
    rig = load_rig(EXAMPLES / "rig-sim.toml").model_copy(update={"simulation": None})
    assert estimate(plan_steps(load_session(EXAMPLES / "session.toml")), rig).disk_bytes is None
