"""Wrong inputs as people make them: exit code, what is said, and what is not."""

import re
import shutil

import numpy as np
import pytest

from rigctl import cli
from tests.rigctl.example_files import EXAMPLES
from tests.rigctl.made_runs import at, make_run

SCENE, ROOF, RIG, SESSION = "scene-panels.toml", "scene-roof.toml", "rig-sim.toml", "session.toml"
TAKE = ("acquire", RIG, SESSION, "--out", "run", "--dry-run")
_PLATE = "{ x = 70, y = 190, width = 150, height = 130 }"
# Neither Python's own words nor a library's, no regular expression, no bytes, no memory addresses.
UGLY = re.compile(
    r"datetime\.|Value error|valid dictionary|instance of|pydantic|Traceback|\bb'|\{'|\^\[|<class|0x[0-9a-f]{6}|\bnan\b"
)

# Command, code, what has to be said; a file changed before: (name, old, new).
CASES = [
    # Commands and options.
    (("comapre",), 2, 'Did you mean "compare"?', ()),
    (("help",), 2, "Try: rigctl --help", ()),
    (("calibrate", "nois"), 2, 'Did you mean "noise"?', ()),
    (("predict",), 2, "SCENE is missing", ()),
    (("predict", SCENE, "more"), 2, "'more': nothing is expected there", ()),
    (("stokes", "--noise"), 2, "--noise needs a value", ()),
    (("predict", SCENE, "--noize", "x"), 2, "--noise", ()),
    (("predict", SCENE, "--tolerance", "abc"), 2, "--tolerance 'abc': must be a number", ()),
    (("effects", SCENE, "--tolerance", "0"), 2, "Must be >= 1e-09", ()),
    (("compare", "x", SCENE, "--scale", "panle", "--out", "o"), 2, 'Did you mean "panel"?', ()),
    (("export", "x", "--to", "tif", "--out", "o"), 2, 'Did you mean "tiff"?', ()),
    (("compare", "x", SCENE, "--alpha", "1.5", "--out", "o"), 2, "allowed is above 0 and below 1", ()),
    (("predict", SCENE, "--seed", "1"), 2, "Unknown option", ()),
    (("predict", SCENE, "--set", "sensor.f_numbr=2"), 2, "did you mean sensor.f_number", ()),
    (("predict", SCENE, "--set", "sensor.f_number=two"), 2, "KEY=VALUE", ()),
    (("sweep", SCENE, "sun.zenith_deg=10:80:8"), 2, "does not state the number 'sun.zenith_deg'", ()),
    (("predict", SCENE, "--without", "textur"), 2, "did you mean texture?", ()),
    (("surface", "black-pant"), 2, "did you mean black-paint?", ()),
    (("demo", "--perturb", "nothing"), 2, 'Choose from: "gain"', ()),
    (("preview", "sim:gc780", "--exposure-ms", "-1"), 2, "Must be > 0", ()),
    (("devices", "--port", "/dev/nowhere"), 2, "there is no such port", ()),
    (("new", ".", "--simulated"), 2, "is not empty", ()),
    (("new", "nn", "--no-input"), 2, "--simulated", ()),
    # One file in the place of another.
    (("predict", RIG), 2, "this is a rig file; give a scene file", ()),
    (("acquire", SESSION, RIG, "--out", "run"), 2, "this is a session file; give a rig file", ()),
    (("infer", "runs/none"), 2, "give a scene file", ()),
    (("predict", SCENE, "--noise", RIG), 4, "this is no JSON file", ()),
    (("predict", "nothere.toml"), 2, "No such file", ()),
    (("verify", SCENE), 4, "is a file; give a run folder", ()),
    (("status", "nowhere"), 4, "there is no such folder", ()),
    (("status", "--contents", "."), 4, "not a run folder", ()),
    # Keys and values of a scene.
    (
        ("predict", SCENE),
        2,
        "sensor.f_nummer: is no known key (found 2.0); did you mean f_number?",
        ("f_number = 2.0", "f_nummer = 2.0"),
    ),
    (("predict", SCENE), 2, "must be a number, { value", ("f_number = 2.0", 'f_number = "two"')),
    (("predict", SCENE), 2, "did you mean std?", ("f_number = 2.0", "f_number = { value = 2.0, sdt = 0.1 }")),
    (("predict", SCENE), 2, "write numbers with a point", ("f_number = 2.0", "f_number = 2,0")),
    (("predict", SCENE), 2, "sensor.f_number: is -2, must be above 0", ("f_number = 2.0", "f_number = -2")),
    (("predict", SCENE), 2, "is not valid TOML", ("[sensor]", "[sensor")),
    (("predict", SCENE), 2, "first [[regions]], rectangle: must be { x = 70", (_PLATE, "[70, 190, 150, 130]")),
    (("predict", SCENE), 2, "did you mean rectangle?", (f"rectangle = {_PLATE}", f"rectangel = {_PLATE}")),
    (("predict", SCENE), 2, "first [[regions]]: stokes_radiance (8, 9, 1.236)", ("[8.0, 2.777", "[8.0, 9.0")),
    (("predict", SCENE), 2, "occur more than once: black_panel", ('"white_panel"', '"black_panel"')),
    (("predict", ROOF), 2, "did you mean black-paint?", ('"black-paint"', '"black-pant"')),
    (("predict", ROOF), 2, "such as 2026-05-04T12:00:00Z", ("2010-05-25T13:07:40-04:00", "2010-05-25T13:07:40")),
    (("predict", ROOF), 2, "(found 'noon')", ("2010-05-25T13:07:40-04:00", '"noon"')),
    (("predict", ROOF), 2, "did you mean 'spheres'?", ('aerosol = "depolarizing"', 'aerosol = "sphere"')),
    (("predict", ROOF), 2, "visibility_km: is -5, must be above 0", ("{ value = 23.0, std = 2.0 }", "-5")),
    (("predict", SCENE), 2, "noise: is missing; it has gain_dn_per_e, read_noise_e", ("[noise]", "[nose]")),
    # Rigs and sessions.
    (TAKE, 2, "did you mean ellx?", ('"ellx"', '"ELL14"')),
    (TAKE, 2, "there are sim:gc780, sim:gige", ('"sim:gc780"', '"sim:gc781"')),
    (TAKE, 2, "did you mean gige?", ('"sim:gc780"', '"gigee:1.2.3.4"')),
    (TAKE, 2, "write DRIVER:PLACE, such as gige:192.168.0.5", ('"sim:gc780"', '"192.168.0.5"')),
    (TAKE, 2, '"/dev/ttyS0" is a real port', ("sim:ellx?speed=20", "/dev/ttyS0")),
    (TAKE, 2, "write the name of a table in brackets, such as [stage]", ("[stage]", "[stage")),
    (TAKE, 2, "polarimetry = false", ("angles_deg = [0, 90, 45, 135]", "angles_deg = [0, 90]")),
    (("new", "nn", "--stage", "newport:/dev/x", "--camera", "gige:1.2.3.4"), 2, "there is no driver 'newport'", ()),
    (("new", "nn", "--simulated", "--latitude-deg", "95", "--longitude-deg", "0"), 2, "Must be <= 90", ()),
    (TAKE, 2, "polarizer.sense: must be 1 or -1 (found 2)", ("sense = -1", "sense = 2")),
    (TAKE, 2, "polarizer.sense: is missing", ("sense = -1\n", "")),
    (TAKE, 2, "'sped' is no key", ("sim:ellx?speed", "sim:ellx?sped")),
    (TAKE, 2, "second [[take]], cycles: must be at least 1 (found 0)", ("cycles = 8", "cycles = 0")),
    (TAKE, 2, "second [[take]], second of angles_deg: must be a number", ("[0, 90, 45", '[0, "ninety", 45')),
    (TAKE, 2, "must be 'scene', 'dark' or 'flat' (found 'light')", ('kind = "scene"', 'kind = "light"')),
    ((*TAKE, "--at", "tomorrow"), 2, "write it like 2026-05-04T10:00Z", ()),
    ((*TAKE, "--at", "2026-05-04T12:00"), 2, "has no zone", ()),
    (("acquire", RIG, "session-rooftop.toml", "--out", "run", "--dry-run"), 2, "needs [site]", ()),
    (("plan", RIG, SCENE), 2, "this is a scene file; give a session file", ()),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("wrong")
    for file in EXAMPLES.glob("*.toml"):
        shutil.copy(file, path)
    return path


@pytest.mark.parametrize(("command", "code", "said", "changed"), CASES, ids=lambda one: None)
def test_a_wrong_input_is_told_in_words_that_help(folder, monkeypatch, capsys, command, code, said, changed):
    monkeypatch.chdir(folder)
    texts = {name: (folder / name).read_text() for name in command if (folder / name).is_file()}
    try:
        if changed:
            name = next(name for name, text in texts.items() if changed[0] in text)
            (folder / name).write_text(texts[name].replace(*changed, 1))
        assert cli.main([*command]) == code
    finally:
        for name, text in texts.items():
            (folder / name).write_text(text)
    found = capsys.readouterr().err
    assert said in found
    assert UGLY.search(found) is None, found
    assert not (folder / "run").exists()


@pytest.mark.parametrize(
    "command", [("plan", RIG, SESSION), ("doctor", RIG, "--frames", "1"), TAKE], ids=lambda one: one[0]
)
def test_placeholders_of_a_rig_are_said_to_be_such(folder, monkeypatch, capsys, command):
    monkeypatch.chdir(folder)
    text = (folder / RIG).read_text()
    try:
        (folder / RIG).write_text(text.replace("sense = -1\n", "sense = -1\nplaceholder = true\n", 1))
        cli.main([*command])
    finally:
        (folder / RIG).write_text(text)
    said = " ".join("".join(capsys.readouterr()).split())
    assert "sense and offset of the polarizer are placeholders" in said


@pytest.fixture(scope="module")
def run_of_placeholders(tmp_path_factory):
    """Return a run of two plates whose rig file had sense and offset as placeholders, and their regions file."""
    path, rng = tmp_path_factory.mktemp("placeholders"), np.random.default_rng(7)
    light = np.full((24, 30), 800.0)
    light[:, 15:] = 400.0
    frames = [
        (at(angle, cycle=cycle, exposure_s=0.01), rng.normal(light * (1 + 0.3 * np.cos(np.radians(2 * angle))), 5.0))
        for cycle in range(2)
        for angle in (0.0, 45.0, 90.0, 135.0)
    ]
    polarizer = {"sense": 1, "offset_deg": 0.0, "placeholder": True}
    make_run(path / "run", frames, session={"origin": "simulated", "rig": {"polarizer": polarizer}})
    plate = "[[regions]]\nname = {name}\nrectangle = {{ x = {x}, y = 2, width = 10, height = 20 }}\n"
    (path / "regions.toml").write_text(plate.format(name='"left"', x=2) + plate.format(name='"right"', x=18))
    return path


@pytest.mark.parametrize("words", ["stokes", "compare", "detect --background left --target right"])
def test_placeholders_of_a_run_are_said_to_be_such(run_of_placeholders, tmp_path, capsys, words):
    verb, *options = words.split()
    regions = str(run_of_placeholders / "regions.toml")
    cli.main([verb, str(run_of_placeholders / "run"), *options, "--regions", regions, "--out", str(tmp_path / "out")])
    assert "are placeholders" in " ".join(capsys.readouterr().err.split())
