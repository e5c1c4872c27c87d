"""Every schema that was ever written is read, and gives the same numbers; later ones are refused by their number."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from drivers.interfaces import DeviceIdentity
from rigctl import cli
from rigctl.calibrations.flat.flat_file import read_flat_facts
from rigctl.calibrations.lens_file import read_lens_file
from rigctl.calibrations.noise.noise_file import read_noise_file
from rigctl.calibrations.polarizer.polarizer_file import read_polarizer_file
from rigctl.calibrations.radiometric_file import read_radiometric_file
from rigctl.calibrations.registration.registration_file import read_registration_file
from rigctl.devices.characterisation_file import load_settle_s
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import load_regions
from rigctl.files.rig_file import load_rig
from rigctl.files.scene_file import load_scene
from rigctl.files.session_file import load_session
from rigctl.jobs.compare import CompareRequest, compare_run
from rigctl.jobs.migrate import migrate
from rigctl.measurement.run_calibrations import CalibrationPaths
from rigctl.runs.run_folder import read_run
from rigctl.runs.wholeness import used_run
from rigctl.verbs.stokes import stokes
from rigctl.verbs.verify import verification_of
from rigctl.version import VERSION

ARCHIVES = Path(__file__).parent / "old_files"
NOW_NS = 1_800_000_000_000_000_000


@pytest.fixture
def old(tmp_path):
    for archive in ARCHIVES.glob("*.zip"):
        with zipfile.ZipFile(archive) as opened:
            opened.extractall(tmp_path / archive.stem)
    return tmp_path


def _numbers(run, regions, **calibrations):
    return stokes(run, regions=regions, calibrations="none", **calibrations).as_json()["regions"]


def _require_same(found, stated):
    for region, quantities in stated.items():
        for quantity, numbers in quantities.items():
            for statistic, value in numbers.items():
                assert found[region][quantity][statistic] == pytest.approx(value, rel=1e-12, abs=1e-12), quantity


def test_the_first_runs_open_and_give_the_same_numbers(old):
    first = old / "first"
    _require_same(_numbers(first / "run", first / "regions.toml"), json.loads((first / "numbers.json").read_text()))
    found = verification_of(first / "run")
    assert (found.state, found.frames) == ("whole", 10)
    assert any("kept no copy" in text for text in found.unchecked)


def test_the_first_run_agrees_with_its_scene_as_it_did(old):
    first = old / "first"
    found = compare_run(
        first / "run",
        CompareRequest(scene=first / "scene.toml", calibrations=CalibrationPaths(noise=first / "noise.json")),
    )
    assert found.comparison.agrees is True


def test_the_last_runs_without_seals_give_the_same_numbers(old):
    late = old / "unsealed"
    found = _numbers(
        late / "run", old / "first/regions.toml", noise=old / "identity/noise.json", flat=late / "flat.npz"
    )
    _require_same(found, json.loads((late / "numbers.json").read_text()))
    assert verification_of(late / "run").state == "whole"


def test_runs_sealed_and_annotated_give_the_same_numbers(old):
    today = old / "today"
    _require_same(
        _numbers(today / "run", today / "regions.toml", noise=today / "noise.json"),
        json.loads((today / "numbers.json").read_text()),
    )
    found = verification_of(today / "run")
    assert (found.state, found.frames, found.unchecked) == ("whole", 14, ())
    used = used_run(today / "run")
    assert [one.sequence for one in used.excluded] == [13]
    assert [(one.kind, one.by) for one in used.annotations] == [("note", "ann"), ("exclude", "bob")]
    calibrations = CalibrationPaths(noise=today / "noise.json")
    compared = compare_run(today / "run", CompareRequest(scene=today / "scene.toml", calibrations=calibrations))
    assert compared.comparison.agrees is True
    assert read_noise_file(today / "noise.json").made_for.exposure_range_s is not None
    assert read_lens_file(today / "lens.json").lens().parameters[0] == pytest.approx(898.18, abs=0.01)
    assert load_scene(today / "scene.toml").pointing.correlation == ((1.0, 0.25), (0.25, 1.0))


def test_all_calibrations_and_files_ever_written_are_read(old):
    assert read_noise_file(old / "first/noise.json").gain_dn_per_e.value == pytest.approx(0.24, rel=0.2)
    assert read_noise_file(old / "identity/noise.json").made_for.camera_serial == "sim-1"
    assert read_polarizer_file(old / "sessions/polarizer.json").origin.stage_serial == "11401326"
    assert read_polarizer_file(old / "identity/polarizer.json").offset_deg.value == pytest.approx(31.7, abs=0.1)
    assert read_registration_file(old / "identity/registration.json").wander is not None
    assert read_radiometric_file(old / "identity/radiometric.json").response_dn_per_radiance.value > 0.0
    assert read_flat_facts(old / "unsealed/flat.npz").kind == "flat"
    stage = DeviceIdentity(model="ELL14", serial_number="11401326", firmware="")
    assert load_settle_s(old / "sessions/stage.json", identity=stage) >= 0.0
    readers = {
        "rig.toml": load_rig,
        "scene.toml": load_scene,
        "session.toml": load_session,
        "regions.toml": load_regions,
    }
    assert all(read(old / "first" / name) for name, read in readers.items())


def test_migration_is_dry_unless_it_is_to_write(old, capsys):
    before = sorted(old.rglob("*"))
    assert (
        cli.main(["migrate", str(old / "first/run"), str(old / "first/noise.json"), str(old / "unsealed/flat.npz")])
        == 0
    )
    assert sorted(old.rglob("*")) == before
    said = capsys.readouterr().out
    assert (said.count("would be written to"), said.count("is the newest")) == (2, 1)


@pytest.mark.parametrize("archive", ["first", "unsealed"])
def test_a_migrated_run_is_whole_and_gives_the_same_numbers(old, archive):
    run = old / archive / "run"
    before = {file: file.read_bytes() for file in run.rglob("*") if file.is_file()}
    copy = migrate(run, write=True, utc_ns=lambda: NOW_NS).copy
    assert {file: file.read_bytes() for file in run.rglob("*") if file.is_file()} == before
    found = verification_of(copy)
    assert (found.state, found.unchecked) == ("whole", ())
    old_frames, new_frames = read_run(run).frames, read_run(copy).frames
    assert [one.checksum for one in new_frames] == [one.checksum for one in old_frames]
    regions = old / "first/regions.toml"
    assert _numbers(copy, regions) == _numbers(run, regions)
    manifest = copy / "manifest.jsonl"
    manifest.write_bytes(manifest.read_bytes().replace(b'"width": 48', b'"width": 49', 1))
    assert verification_of(copy).state == "damaged"
    with pytest.raises(ConfigError, match="is there already"):
        migrate(run, write=True)


@pytest.mark.parametrize(("file", "schema"), [("first/noise.json", 2), ("sessions/polarizer.json", 2)])
def test_a_migrated_calibration_says_the_same(old, file, schema):
    read = read_noise_file if "noise" in file else read_polarizer_file
    copy = migrate(old / file, write=True, utc_ns=lambda: NOW_NS).copy
    before, after = read(old / file), read(copy)
    assert (before.schema_version, after.schema_version) == (1, schema)
    assert after.origin == before.origin
    assert migrate(copy, write=True).copy is None


def _with_schema(path, version, **more):
    content = json.loads(path.read_text()) | {"schema_version": version, "created_by": "rigctl 9.1.0"} | more
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("file", "reads"),
    [
        ("first/noise.json", "1 to 2"),
        ("identity/polarizer.json", "1 to 2"),
        ("identity/registration.json", "1"),
        ("identity/radiometric.json", "1"),
    ],
)
def test_a_later_calibration_is_refused_by_its_number(old, file, reads):
    _with_schema(old / file, 7, sense="of another kind", gain_dn_per_e="too")
    readers = {
        "noise": read_noise_file,
        "polarizer": read_polarizer_file,
        "registration": read_registration_file,
        "radiometric": read_radiometric_file,
    }
    with pytest.raises(DataError) as refused:
        readers[Path(file).stem](old / file)
    assert f"schema_version is 7, and rigctl {VERSION} reads {reads}; rigctl 9.1.0 wrote it" in str(refused.value)


def test_later_flats_and_runs_are_refused_by_their_number(old, capsys):
    flats = old / "unsealed/flat.npz"
    kept = dict(np.load(flats))
    facts = json.loads(kept["facts"].tobytes()) | {"schema_version": 2, "created_by": "rigctl 9.1.0"}
    np.savez(flats, **(kept | {"facts": np.frombuffer(json.dumps(facts).encode(), dtype=np.uint8)}))
    with pytest.raises(DataError, match=r"schema_version is 2, and rigctl .* reads 1; rigctl 9.1.0 wrote it"):
        read_flat_facts(flats)
    run = old / "first/run"
    _with_schema(run / "session.json", 3, more={"of": "later"})
    assert cli.main(["status", "--contents", str(run)]) == 4
    assert "schema_version is 3, and rigctl" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["rig.toml", "scene.toml", "session.toml", "regions.toml"])
def test_a_later_file_of_people_is_refused_by_its_number(old, name):
    file = old / "first" / name
    file.write_text(f"schema_version = 2\nof_later = true\n{file.read_text()}")
    readers = {
        "rig.toml": load_rig,
        "scene.toml": load_scene,
        "session.toml": load_session,
        "regions.toml": load_regions,
    }
    with pytest.raises(ConfigError, match=r"schema_version is 2, and rigctl .* reads 1; a later rigctl reads it"):
        readers[name](file)
